"""Backups: whole numbers or nothing, and what says which requests are answered comes last."""

from collections.abc import Mapping
from typing import Any

import pytest

import servobus
from samples import can_be_silenced, models_that, ram_setting, sample_models, sample_of
from servobus import MODELS, Backup, BusServo, NoReply, UsageError
from servobus.core.registers import Area
from servobus.families.base import Answers, Model
from unit.lossy import ASYNC, SYNC, Bench

DRIVERS = pytest.mark.parametrize("driver", [SYNC, ASYNC])
WITH_POLICY = models_that(can_be_silenced)


def later(model: type[Model]) -> tuple[str, int]:
    """Name a setting that comes behind the policy in the table, and give another value for it."""
    rows = list(model.registers.values())
    behind = rows[rows.index(model.register("answer_level")) + 1 :]
    row = next(row for row in behind if row.area is Area.EEPROM and row.writable and row.default)
    return row.name, row.limits[0]


def edited(saved: Backup, values: Mapping[str, int]) -> Backup:
    return Backup(saved.model, saved.firmware, saved.id, saved.baud, {**saved.values, **values})


def works(bench: Bench) -> None:
    """Check that driver and servo agree on what is answered: else a write would wait in vain, or not be waited for."""
    row = ram_setting(bench.real.model)
    assert row is not None
    raw = (row.default or 0) + 1
    bench.line.lose()
    bench.do(lambda servo: servo.write_raw({row: raw}))
    bench.do(lambda servo: servo.ping())
    assert len(bench.line.requests) == 2
    assert bench.real.get(row.name) == raw


@DRIVERS
@WITH_POLICY
@pytest.mark.parametrize("old", [Answers.READS, Answers.EVERYTHING])
@pytest.mark.parametrize("new", list(Answers))
def test_a_restored_policy_is_written_last_and_learned(key: str, driver: str, old: Answers, new: Answers) -> None:
    bench = Bench(key, driver, old)
    policy = bench.servo.model.register("answer_level").name
    name, raw = later(bench.servo.model)
    saved = edited(bench.do(lambda servo: servo.backup()), {policy: new, name: raw})
    changed = bench.do(lambda servo: servo.restore(saved))
    assert set(changed) == ({policy, name} if old is not new else {name})
    bench.line.sleep(0.01)
    assert (bench.stored(policy), bench.stored(name)) == (new, raw)
    assert bench.servo.target.answers is new
    works(bench)


@DRIVERS
@WITH_POLICY
@pytest.mark.parametrize("verb", ["write_many", "write_raw", "store"])
@pytest.mark.parametrize("first", [True, False])
def test_a_policy_among_others_is_written_last(key: str, driver: str, verb: str, first: bool) -> None:
    bench = Bench(key, driver, Answers.EVERYTHING)
    name, raw = later(bench.servo.model)
    row = bench.servo.model.register(name)
    values: dict[str, Any] = {"answer_level": Answers.READS, name: raw if verb == "write_raw" else row.decode(raw)}
    if not first:
        values = dict(reversed(values.items()))
    bench.do(lambda servo: getattr(servo, verb)(values))
    assert bench.do(lambda servo: servo.read_raw([name])) == [raw]
    assert bench.servo.target.answers is Answers.READS
    works(bench)


@WITH_POLICY
def test_a_policy_whose_write_was_not_answered_is_asked_for(key: str) -> None:
    bench = Bench(key, SYNC, Answers.EVERYTHING)
    servo: Any = bench.servo
    refused: list[bytes] = []

    def lose_the_answer(request: bytes) -> bool:
        """Cut the line for one write of the policy, after the servo has got it."""
        if request[4] == 3 and not refused:  # WRITE_DATA; of a HerkuleX the write is not waited for
            refused.append(request)
            bench.line._deaf = True
        return True

    bench.line.on_request = lose_the_answer
    policy = servo.model.register("answer_level")
    if sample_of(key).acknowledges_level:
        with pytest.raises(NoReply):
            servo.write(policy, Answers.READS)
    else:
        servo.write(policy, Answers.READS)
    bench.line.on_request = None
    assert servo.target.answers is Answers.READS
    works(bench)


def servo_of(key: str) -> BusServo:
    return servobus.open(f"virtual:{key}@1?clock=virtual").find(1, family=MODELS[key].family)


@pytest.mark.parametrize(
    ("was", "becomes", "said"),
    [
        (
            "max_torque = 1023",
            "max_torque = 511.9",
            r"max_torque in line 18 is 511\.9, and a raw value is a whole number",
        ),
        ("max_torque = 1023", "max_torque = 511.0", r"max_torque in line 18 is 511\.0, and"),
        ("alarm_led = 36", "alarm_led = true", "alarm_led in line 20 is True, and"),
        ("alarm_led = 36", 'alarm_led = "36"', "alarm_led in line 20 is '36', and"),
        ("baud = 57600", "baud = 57600.0", r"baud in line 5 is 57600\.0, and"),
        ("id = 1\n", "id = true\n", "id in line 4 is True, and"),
        ("max_torque = 1023", "max_torque = 65536", "max_torque in line 18 is 65536, which 2 bytes cannot hold"),
        ("max_torque = 1023", "max_torque = 10x3", r"line 18 \(max_torque = 10x3 "),
        ("max_torque = 1023", "max_torque 1023", r"line 18 \(max_torque 1023 "),
        ("max_torque = 1023", "moving = 1", "moving in line 18 is no setting that survives power-off"),
        (
            "max_torque = 1023",
            "max_turk = 1023",
            "in line 18: RX-28 has no register 'max_turk'; did you mean max_torque",
        ),
        ('model = "rx28"', 'model = "rx82"', "model in line 2: no model 'rx82'; did you mean rx28"),
        ('model = "rx28"', "model = 28", "model in line 2 is 28, and it should be a text"),
        ("[settings]", "[sattings]", "it has no settings"),
        ("id = 1\n", "", "it has no id"),
        (
            "max_torque = 1023",
            "max_torque = 1023\nmax_temperature = 80",
            "highest_limit_temperature stands in it twice",
        ),
    ],
)
def test_what_is_no_raw_value_is_refused_with_its_line(was: str, becomes: str, said: str) -> None:
    text = servo_of("rx28").backup().text()
    assert was in text
    with pytest.raises(UsageError, match=said):
        Backup.parse(text.replace(was, becomes))


def test_an_alias_in_a_backup_is_restored_too() -> None:
    servo = servo_of("rx28")
    saved = Backup.parse(servo.backup().text().replace("highest_limit_temperature = 80", "max_temperature = 70"))
    assert servo.restore(saved) == ["highest_limit_temperature"]
    assert servo.read("max_temperature") == 70.0


def test_damaged_backups_are_refused() -> None:
    for text in ("model = 3", 'model = "rx28"', "not toml at all ["):
        with pytest.raises(UsageError, match="damaged"):
            Backup.parse(text)


@pytest.mark.parametrize("text", ["", "\n", "  \n\n"])
def test_T4_an_empty_file_is_said_to_be_empty(text: str) -> None:
    with pytest.raises(UsageError, match=r"^the file is empty: it holds no backup$"):
        Backup.parse(text)


@sample_models
def test_T4_a_backup_that_is_cut_off_anywhere_is_never_taken_for_something_else(key: str) -> None:
    """A file that ends in the middle of a line names it, and one that ends behind a line says how many are missing."""
    saved = servo_of(key).backup()
    text = saved.text()
    last = text.rindex("#") + 1
    ends = {*range(0, last, 7), *(n + 1 for n, letter in enumerate(text[:last]) if letter == "\n")}
    for end in sorted(ends):
        with pytest.raises(UsageError, match=r"line|it has no|empty"):
            Backup.parse(text[:end])
    assert Backup.parse(text[:last]).values == saved.values
    with pytest.raises(UsageError, match=rf"says {len(saved.values)} settings, and {len(saved.values) - 1} are here"):
        Backup.parse(text[: text.rindex("\n", 0, last) + 1])


def test_a_backup_of_an_older_version_has_no_count() -> None:
    saved = servo_of("rx28").backup()
    older = saved.text().replace(f"count = {len(saved.values)}\n", "")
    assert Backup.parse(older) == saved
