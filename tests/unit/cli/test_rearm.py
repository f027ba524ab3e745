import os
from collections.abc import Callable

import pytest

from unit.cli.conftest import ALL, Run
from unit.served import Arm

posix = pytest.mark.skipif(os.name != "posix", reason="pseudo terminals as on POSIX")


@pytest.mark.parametrize("family", ALL)
def test_rearm_gives_torque_where_the_servo_is(run: Run, family: str) -> None:
    port, id = ALL[family]
    before = run("read", port, id, "present_position").stdout.split()[-1]
    result = run("rearm", port, id)
    assert result.stdout.endswith(f" id {id}: torque on, holds {before}\n")
    assert result.stderr == ""


@pytest.mark.parametrize(("family", "cause"), [("dynamixel", "overheating"), ("lewansoul", "over_temperature")])
def test_rearm_is_refused_while_it_is_too_hot(refused: Callable[..., str], family: str, cause: str) -> None:
    port, id = ALL[family]
    said = refused("rearm", f"{port}&temperature=90", id)
    assert f" id {id}: the torque stays off, for the cause is still there: {cause}" in said


@posix
def test_a_refusal_says_what_was_done(refused: Callable[..., str]) -> None:
    with Arm("rx28@1") as arm:
        arm.servos[0].temperature = 90.0  # it is beyond its limit, 80 °C
        arm.servos[0].put("torque_enable", 1)
        arm.servos[0].put("torque_limit", 0)
        assert refused("rearm", arm.name, 1).endswith(
            ": overheating; torque_enable is off now, so it goes nowhere when that is over\n"
        )
        assert arm.servos[0].get("torque_enable") == 0


def test_an_id_or_speed_is_not_written_like_a_setting(refused: Callable[..., str]) -> None:
    for setting, verb in (("id=7", "set-id"), ("baud=1000000", "set-baud")):
        port, id = ALL["dynamixel"]
        for more in ((), ("--save",)):
            assert f"changed by `servobus {verb}`" in refused("write", port, id, setting, *more)
