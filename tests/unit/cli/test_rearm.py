from collections.abc import Callable

import pytest

from unit.cli.conftest import ALL, Run


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
    assert said.endswith(f" id {id}: the torque stays off, for the cause is still there: {cause}\n")


def test_an_id_or_speed_is_not_written_like_a_setting(refused: Callable[..., str]) -> None:
    for setting, verb in (("id=7", "set-id"), ("baud=1000000", "set-baud")):
        port, id = ALL["dynamixel"]
        for more in ((), ("--save",)):
            assert f"changed by `servobus {verb}`" in refused("write", port, id, setting, *more)
