from collections.abc import Callable
from itertools import count
from pathlib import Path

import pytest

from servobus import MODELS, BusError, PortError, UsageError
from servobus.core.registers import Area
from servobus.errors import ServobusError
from servobus.families.base import policy_register
from servobus.robots.blocking import Robot
from servobus.robots.settings import adopting
from servobus.robots.settings.backups import Backups
from unit.robots.settings.workshop import Killed, Workshop

SETTING = {"rx28": "max_torque", "drs0602": "dead_zone", "lx16a": "max_temperature"}
"""Some setting of each model that is no limit."""
OTHER_BAUD = {"rx28": 1_000_000, "drs0602": 57_600}
"""Speed of a new servo of each model that can have several."""


def shop_of(folder: Path, key: str, level: int | None = None) -> Workshop:
    """Make a robot of which servo 3 has died, and on whose wire a new one stands with id 9.

    `level` is what servo 3 answered: another than the new one does.
    """
    limits = 'limits = ["-30deg", "60deg"]\nlimits_in_servo = true\n'
    zero = {"rx28": "150deg", "drs0602": "0deg", "lx16a": "120deg"}[key]
    joints = "".join(
        f'[joint.{name}]\nport = "wire"\nmodel = "{key}"\nid = {id}\nzero = "{zero}"\n{limits}'
        for name, id in (("one", 1), ("two", 2), ("three", 3))
    )
    shop = Workshop(folder, joints, {"wire": f"{key}@1-3,9"})
    old, new = shop.servo("wire", 3), shop.servo("wire", 9)
    setting = old.model.register(SETTING[key])
    old.memory.store(setting, old.memory.eeprom[setting] - 5 if key != "drs0602" else 5)
    old.power_on(0.0)
    if key in OTHER_BAUD:
        new.store_baud(OTHER_BAUD[key])
        new.power_on(0.0)
    shop.unplug("wire", 9)
    with shop.open() as arm:
        if level is not None:
            arm["three"].servo.store({policy(key): level})
        arm.apply_settings()
    shop.unplug("wire", 3)
    shop.plug("wire", 9)
    return shop


def adopt(shop: Workshop, arm: Robot) -> None:
    """Do what the command does."""
    bus = arm.buses["wire"]
    arm.check(strangers="near")
    backups = Backups(arm.file)
    if (left := adopting.left_over(arm.attendance, arm.joints, backups, None)) is not None:
        with backups.adopting("three", 0, left[1]):
            bus.do(adopting.finish(*left))
        return
    vacancy = adopting.vacant(arm.attendance, arm.joints, None)
    found = bus.do(adopting.newcomer(bus, vacancy, [part for joint in arm for part in joint.parts], ids=range(10)))
    plan = bus.do(adopting.adoption(vacancy, found, backups.last("three", 0), "last"))
    kept = backups.keep_new("three", 0, plan.before)
    with backups.adopting("three", 0, plan.wanted):
        bus.do(adopting.carry_out(plan, "PORT", kept))


def settings(shop: Workshop, n: int) -> dict[str, int]:
    servo = shop.rigs["wire"].servos[n]
    return {row.name: servo.memory.eeprom[row] for row in servo.model.registers.values() if row.area is Area.EEPROM}


@pytest.mark.parametrize("key", SETTING)
def test_a_new_servo_becomes_what_the_old_one_was(tmp_path: Path, key: str) -> None:
    shop = shop_of(tmp_path, key)
    position = shop.rigs["wire"].servos[3].position
    with shop.open() as arm:
        assert not arm.check(strangers="near")
        adopt(shop, arm)
        assert arm.check()
        assert arm.plan_settings().changes() == 0
    assert settings(shop, 3) == settings(shop, 2)
    assert shop.rigs["wire"].servos[3].position == pytest.approx(position, abs=1e-6)


@pytest.mark.parametrize("key", ["rx28", "drs0602"])
def test_broken_off_anywhere_the_same_again_goes_on(tmp_path: Path, key: str) -> None:
    requests = _requests(tmp_path, key)
    assert requests > 12
    for n, kill_at in enumerate(range(1, requests, requests // 3)):
        folder = tmp_path / f"kill{n}"
        folder.mkdir()
        shop = shop_of(folder, key)
        with shop.open() as arm, pytest.raises(Killed):
            _kill(shop, kill_at)
            adopt(shop, arm)
        shop.before = lambda _: None
        with shop.open() as arm:
            if not arm.check(strangers="near"):
                adopt(shop, arm)
            arm.apply_settings()
            assert arm.check()
        assert settings(shop, 3) == settings(shop, 2)


@pytest.mark.parametrize(("key", "level"), [("rx28", 1), ("drs0602", 2)])
def test_killed_in_its_place_before_it_answers_as_the_old_one_did_the_same_again_does_the_rest(
    tmp_path: Path, key: str, level: int
) -> None:
    row = policy(key)
    in_between = 0
    for kill_at in count(1, 6):
        folder = tmp_path / f"kill{kill_at}"
        folder.mkdir()
        shop = shop_of(folder, key, level)
        killed = False
        with shop.open() as arm:
            shop.before = _when_in_place(shop, kill_at)
            try:
                adopt(shop, arm)
            except Killed:
                killed = True
        shop.before = lambda _: None
        in_between += settings(shop, 3)[row] != settings(shop, 2)[row]
        with shop.open() as arm:
            if not arm.check(strangers="near") or killed:
                adopt(shop, arm)
            assert not list((folder / "arm.backups" / "adopting").iterdir())
            assert arm.check(strangers="near")
        assert settings(shop, 3) == settings(shop, 2)
        if not killed:
            break
    assert in_between


def policy(key: str) -> str:
    """Give the name of the register that says which requests a servo answers."""
    row = policy_register(MODELS[key])
    assert row is not None
    return row.name


def _when_in_place(shop: Workshop, at: int) -> Callable[[bytes], None]:
    """End the program at this request after the new servo has its id, counted from 0."""
    numbers = count()

    def look(_: bytes) -> None:
        if settings(shop, 3)["id"] == 3 and next(numbers) == at:
            raise Killed

    return look


def _kill(shop: Workshop, at: int) -> None:
    """End the program at this request from the first on that writes, counted from 0."""
    numbers = count()
    writing = False
    before = shop.memories()

    def look(_: bytes) -> None:
        nonlocal writing
        writing = writing or shop.memories() != before
        if writing and next(numbers) == at:
            raise Killed

    shop.before = look


def _requests(folder: Path, key: str) -> int:
    """Count the requests from the first on that follows a write."""
    where = folder / "count"
    where.mkdir()
    shop = shop_of(where, key)
    total, before = [0], shop.memories()

    def look(_: bytes) -> None:
        total[0] += bool(total[0]) or shop.memories() != before

    shop.before = look
    with shop.open() as arm:
        adopt(shop, arm)
    return total[0]


def test_a_pulled_cable_says_what_was_there_before(tmp_path: Path) -> None:
    shop = shop_of(tmp_path, "rx28")
    before = settings(shop, 3)
    with shop.open() as arm:

        def cut(_: bytes) -> None:
            if settings(shop, 3)["baud_rate"] != before["baud_rate"]:
                shop.rigs["wire"].unplug([shop.rigs["wire"].servos[3]], shop.now)

        shop.before = cut
        with pytest.raises((BusError, PortError)) as failure:
            adopt(shop, arm)
        text = str(failure.value)
    assert "the new servo was id 9 at 1000000 baud before; `servobus robot adopt` again goes on from here" in text
    assert "`servobus set-id PORT 3 9 --model rx28 --baud all`, then `servobus restore PORT 9 " in text
    assert "then `servobus set-baud PORT 9 1000000 --model rx28 --baud all` bring back" in text
    assert failure.value.before["id"] == 9


def test_a_new_servo_with_torque_is_let_go_first(tmp_path: Path) -> None:
    shop = shop_of(tmp_path, "lx16a")
    new = shop.rigs["wire"].servos[3]
    with shop.open() as arm:
        arm.buses["wire"].attach(new.model, 9).torque_on()
        torque = [new.torque]
        adopt(shop, arm)
        torque.append(new.torque)
    assert torque == [True, False]
    assert settings(shop, 3) == settings(shop, 2)


def refused(shop: Workshop) -> str:
    before = shop.memories()
    with shop.open() as arm, pytest.raises(ServobusError) as failure:
        adopt(shop, arm)
    assert isinstance(failure.value, UsageError)
    assert shop.memories() == before
    return str(failure.value)


def test_nobody_new_or_too_many(tmp_path: Path) -> None:
    shop = shop_of(tmp_path, "rx28")
    shop.unplug("wire", 9)
    with shop.open():
        pass
    assert "three (RX-28 id 3 on wire): no new servo answers at any speed" in refused(shop)
    shop.plug("wire", 9)
    shop.unplug("wire", 2)
    assert "two, three are missing; connect the new servo of one of them" in refused(shop)
    shop.plug("wire", 2)
    shop.plug("wire", 3)
    assert "all servos answer, so no new one is needed" in refused(shop)
    text = shop.path.read_text()
    shop.path.write_text(text[: text.index("[joint.two]")] + text[text.index("[joint.three]") :])
    shop.unplug("wire", 3)
    assert (
        "2 servos are in no joint: RX-28 id 2 at 57600 baud, RX-28 id 9 at 1000000 baud; leave only the new one"
        in refused(shop)
    )


def test_another_model_is_no_newcomer(tmp_path: Path) -> None:
    shop = shop_of(tmp_path, "rx28")
    other = Workshop(tmp_path, shop.path.read_text().split("\n", 4)[-1], {"wire": "rx28@1,2,ax12a@9"})
    assert "three (RX-28 id 3 on wire): AX-12A id 9 at 1000000 baud is no RX-28" in refused(other)
