"""What is remembered of servos that cannot say their model: the file, and what a bus makes of it."""

import asyncio
import os
import subprocess
import sys
import threading
from collections.abc import Callable
from pathlib import Path

import pytest

import servobus
from servobus import Bus, UsageError, deg
from servobus.bus import remembered
from servobus.bus.remembered import Remembered, forget, place, remember
from servobus.families import registry
from servobus.families.dynamixel.verbs import DYNAMIXEL1
from servobus.families.lewansoul.verbs import LEWANSOUL
from servobus.transports import file_lock
from servobus.transports.usb_adapter import Adapter, lasting_name
from servobus.virtual.serve.inprocess import connect

PORT = "virtual:hts35h@1-3?clock=virtual"
LX16A, HTS35H = registry.model("lx16a"), registry.model("hts35h")


@pytest.fixture(autouse=True)
def file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path))
    return tmp_path / "servobus" / "models.toml"


@pytest.fixture
def told() -> list[str]:
    return []


def put(file: Path, text: str) -> None:
    file.parent.mkdir(exist_ok=True)
    file.write_text(text, encoding="utf-8")


def titles(bus: Bus, **where: object) -> list[str]:
    return [servo.model.title for servo in bus.scan(ids=range(1, 5), **where)]  # type: ignore[arg-type]


UNKNOWN = "LX/HTS bus servo, model unknown"

# What a bus makes of it


def test_without_a_file_a_servo_is_of_an_unknown_model() -> None:
    with servobus.open(PORT) as bus:
        assert titles(bus) == [UNKNOWN] * 3


def test_what_is_remembered_counts_from_the_next_look_on(file: Path) -> None:
    with servobus.open(PORT) as bus:
        remember(PORT, "", [1, 3], HTS35H)
        assert titles(bus) == ["HTS-35H", UNKNOWN, "HTS-35H"]
        assert bus.find(2).model.title == UNKNOWN
        remember(PORT, "", None, LX16A)
        assert titles(bus) == ["HTS-35H", "LX-16A", "HTS-35H"]
    assert file.exists()


def test_both_drivers_know_it() -> None:
    remember(PORT, "", [2], HTS35H)

    async def look() -> list[str]:
        async with servobus.open_async(PORT) as bus:
            return [servo.model.title for servo in await bus.scan(ids=range(1, 5))]

    assert asyncio.run(look()) == [UNKNOWN, "HTS-35H", UNKNOWN]


def test_attach_then_models_then_what_is_remembered() -> None:
    remember(PORT, "", [1, 2, 3], HTS35H)
    with servobus.open(PORT, models={2: "lx224", 3: "lx224"}) as bus:
        bus.attach("lx15d", 3)
        assert titles(bus) == ["HTS-35H", "LX-224", "LX-15D"]


def test_another_port_has_other_servos() -> None:
    remember("virtual:lx16a@1", "", [1], HTS35H)
    with servobus.open(PORT) as bus:
        assert titles(bus) == [UNKNOWN] * 3


def test_opening_looking_and_moving_write_nothing(file: Path) -> None:
    with servobus.open(PORT) as bus:
        servo = bus.find(1)
        with servo.torque():
            servo.move(130 * deg).wait()
        servo.restore(servo.backup())
        servo.change_id(9)
    assert not file.parent.exists()


# A servo that says what it is


@pytest.mark.parametrize(("name", "noted"), [("drs0602", False), ("rx28", True), ("lx16a", False)])
def test_a_servo_that_says_what_it_is_is_believed(file: Path, told: list[str], name: str, noted: bool) -> None:
    port = "virtual:ax12a@1?clock=virtual" if "ax12a" in servobus.MODELS else "virtual:rx28@1?clock=virtual"
    put(file, f'["{port}"]\n1 = "{name}"\n')
    bus = Bus(connect(port))
    bus.remembered.tell = told.append
    (servo,) = bus.scan(ids=[1], family="dynamixel")
    assert servo.model.key() == port.partition(":")[2].partition("@")[0]
    expected = [f"id 1 is remembered as {registry.model(name).title}, and says itself what it is: that is believed"]
    assert told == (expected if noted and servo.model.key() != name else [])
    bus.scan(ids=[1], family="dynamixel")
    assert len(told) <= 1  # once is enough


@pytest.mark.parametrize("name", ["rx28", "drs0602"])
def test_a_model_that_says_what_it_is_is_not_remembered(name: str, file: Path) -> None:
    with pytest.raises(UsageError, match="say themselves what they are"):
        remember(PORT, "", [1], registry.model(name))
    assert not file.exists()


def test_an_unknown_model_is_not_remembered(file: Path) -> None:
    with pytest.raises(UsageError, match="lx is no model but stands for an unknown one"):
        remember(PORT, "", [1], registry.model("lx"))
    assert not file.exists()


# Another id


def test_it_goes_along_with_a_new_id() -> None:
    remember(PORT, "", [1, 9], HTS35H)
    remember(PORT, "", [9], LX16A)  # of a servo that is there no more
    with servobus.open(PORT) as bus:
        bus.find(1).change_id(9)
        assert titles(bus) == [UNKNOWN, UNKNOWN]
        assert bus.find(9).model.title == "HTS-35H"
    assert remembered.everything() == {PORT: {"9": "hts35h"}}


def test_nothing_goes_along_where_nothing_is_remembered(file: Path) -> None:
    remember(PORT, "", [2], HTS35H)
    before = file.read_text(encoding="utf-8")
    with servobus.open(PORT) as bus:
        bus.find(1).change_id(9)
    assert file.read_text(encoding="utf-8") == before


def test_a_servo_of_another_family_takes_nothing_along() -> None:
    port = "virtual:rx28@1,lx16a@2?clock=virtual"
    remember(port, "", [1], HTS35H)
    with servobus.open(port) as bus:
        bus.find(1, family="dynamixel").change_id(9)
    assert remembered.everything() == {port: {"1": "hts35h"}}


def test_an_id_is_changed_though_the_file_cannot_be_written(file: Path, told: list[str]) -> None:
    remember(PORT, "", [1], HTS35H)
    with servobus.open(PORT) as bus:
        bus.remembered.tell = told.append
        servo = bus.find(1)
        file.with_name(".models.toml.new").mkdir()
        servo.change_id(9)
        assert servo.id == 9
    (problem,) = told
    assert problem.startswith(f"the servo with id 9 is still remembered under id 1: {file} cannot be written")


# The file


def test_the_file_is_for_people_too(file: Path) -> None:
    remember("0403:6001 serial number A50285BI", "FTDI FT232R USB UART", [12, 3], HTS35H)
    remember("socket://pi.local:3333", "", None, LX16A)
    remember("0403:6001 serial number A50285BI", "FTDI FT232R USB UART", [7], LX16A)
    assert file.read_text(encoding="utf-8").splitlines()[2:] == [
        '["0403:6001 serial number A50285BI"]',
        'adapter = "FTDI FT232R USB UART"',
        '3 = "hts35h"',
        '7 = "lx16a"',
        '12 = "hts35h"',
        "",
        '["socket://pi.local:3333"]',
        'all = "lx16a"',
    ]


@pytest.mark.parametrize(
    "name", ['a "quoted" one', "back\\slash", "tab\there", "Größe µ", "new\nline", "a]b[c", "\x7f"]
)
def test_any_name_of_a_port_is_kept(name: str) -> None:
    remember(name, name, [1], HTS35H)
    assert Remembered(name).model(LEWANSOUL, 1, None) is HTS35H
    assert forget(name, [1]) == ["1"]
    assert remembered.everything() == {}


def test_what_is_forgotten() -> None:
    remember(PORT, "words", [1, 2, 3], HTS35H)
    remember("other", "", [1], HTS35H)
    assert forget(PORT, [2, 8]) == ["2"]
    assert forget(PORT, [2]) == []
    assert sorted(forget(PORT, None)) == ["1", "3"]
    assert remembered.everything() == {"other": {"1": "hts35h"}}


def test_to_forget_makes_no_file(file: Path) -> None:
    assert forget(PORT, None) == []
    assert not file.parent.exists()


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ('["port"]\n1 = "lx16a"\n2 = lx16a\n', "line 3: "),
        ('["port"]\n1 = "lx16a"\n1 = "lx16a"\n', "line 3: "),
        ('["port"\n1 = "lx16a"\n', "line 1: "),
        ('["port"]\n1 = "lx16a', "line 2: "),
        ('["port"]\n1 = "lx16a"\n2 = 16\n', 'line 3: 2 is no name of a model, such as "lx16a"'),
        ('["port"]\n1 = "lx16a"\n254 = "lx16a"\n', "line 3: 254 is no id"),
        ('["port"]\n1 = "lx16a"\nelbow = "lx16a"\n', "line 3: elbow is no id"),
        ('1 = "lx16a"\n', "line 1: 1 belongs into the table of an adapter"),
    ],
)
def test_a_damaged_file_is_told_by_line_and_left_alone(file: Path, told: list[str], text: str, problem: str) -> None:
    put(file, text)
    one = Remembered("port", told.append)
    assert one.model(LEWANSOUL, 1, None) is None
    assert one.model(LEWANSOUL, 1, None) is None
    (said,) = told
    assert said.startswith(f"{file}, {problem}")
    assert said.endswith("it is left out")
    change: Callable[[], object]
    for change in (lambda: remember("port", "", [1], HTS35H), lambda: forget("port", [1])):
        with pytest.raises(UsageError, match=problem.partition(":")[0]):
            change()
    assert file.read_text(encoding="utf-8") == text
    assert [one.name for one in file.parent.iterdir()] == ["models.toml"]


def test_bytes_that_are_no_text_are_told_by_line(file: Path, told: list[str]) -> None:
    file.parent.mkdir()
    file.write_bytes(b'["port"]\n1 = "lx\xff16a"\n')
    assert Remembered("port", told.append).model(LEWANSOUL, 1, None) is None
    assert told == [f"{file}, line 2: it is no text in UTF-8; it is left out"]


def test_a_model_that_is_not_known_here_leaves_the_others_and_stays(file: Path, told: list[str]) -> None:
    put(file, '["port"]\n1 = "lx999"\n2 = "HTS-35H"\n')
    one = Remembered("port", told.append)
    assert one.model(LEWANSOUL, 1, None) is None
    assert one.model(LEWANSOUL, 2, None) is HTS35H
    assert len(told) == 1
    assert told[0].startswith(f"{file}, line 2: no model 'lx999'")
    remember("port", "", [3], LX16A)
    assert remembered.everything()["port"] == {"1": "lx999", "2": "HTS-35H", "3": "lx16a"}


def test_a_damaged_file_does_not_keep_a_bus_from_working(file: Path, caplog: pytest.LogCaptureFixture) -> None:
    put(file, "what?")
    with servobus.open(PORT) as bus:
        assert titles(bus) == [UNKNOWN] * 3
    assert f"{file}, line 1: " in caplog.text


def test_a_folder_that_cannot_be_written_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "taken").write_text("a file where a folder should be")
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "taken"))
    with pytest.raises(UsageError, match=r"models.toml cannot be written: .*; XDG_CONFIG_HOME can name another folder"):
        remember("port", "", [1], HTS35H)
    assert Remembered("port").model(LEWANSOUL, 1, None) is None


@pytest.mark.skipif(sys.platform == "win32" or os.geteuid() == 0, reason="who may write everywhere")
def test_a_read_only_folder_is_told(tmp_path: Path) -> None:
    tmp_path.chmod(0o500)
    with pytest.raises(UsageError, match="Permission denied"):
        remember("port", "", [1], HTS35H)


def test_a_crash_while_it_is_written_leaves_the_old_one(file: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    remember("port", "", [1], HTS35H)
    before = file.read_bytes()

    def crash(_: int) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(os, "fsync", crash)
    with pytest.raises(KeyboardInterrupt):
        remember("port", "", [2], HTS35H)
    assert file.read_bytes() == before
    monkeypatch.undo()
    monkeypatch.setenv("XDG_CONFIG_HOME", str(file.parent.parent))
    remember("port", "", [3], HTS35H)
    assert remembered.everything() == {"port": {"1": "hts35h", "3": "hts35h"}}


def test_a_link_stays_a_link(file: Path, tmp_path: Path) -> None:
    real = tmp_path / "dotfiles.toml"
    real.write_text("")
    file.parent.mkdir()
    file.symlink_to(real)
    remember("port", "", [1], HTS35H)
    assert file.is_symlink()
    assert "hts35h" in real.read_text(encoding="utf-8")


def test_writers_at_one_time_lose_nothing() -> None:
    writers = [threading.Thread(target=remember, args=(f"port {n % 3}", "", [n], HTS35H)) for n in range(24)]
    for writer in writers:
        writer.start()
    for writer in writers:
        writer.join()
    assert sum(len(table) for table in remembered.everything().values()) == 24


def test_programs_at_one_time_lose_nothing(file: Path) -> None:
    code = (
        "import sys; from servobus.bus.remembered import remember; from servobus.families.registry import model\n"
        "for n in range(10): remember('port', '', [10 * int(sys.argv[1]) + n], model('hts35h'))"
    )
    programs = [subprocess.Popen([sys.executable, "-c", code, str(n)]) for n in range(3)]
    assert [program.wait(60) for program in programs] == [0, 0, 0]
    assert len(remembered.everything()["port"]) == 30
    assert [one.name for one in file.parent.iterdir()] == ["models.toml"]


def test_a_writer_that_does_not_end_is_not_waited_for_long(file: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(file_lock, "PATIENCE", 0.05)
    file.parent.mkdir()
    with remembered._changed(), pytest.raises(UsageError, match="cannot be written"):
        remember("port", "", [1], HTS35H)


# Where it is


@pytest.mark.parametrize(
    ("system", "variables", "expected"),
    [
        ("linux", {"XDG_CONFIG_HOME": "/there"}, "/there/servobus/models.toml"),
        ("linux", {}, "/home/me/.config/servobus/models.toml"),
        ("linux", {"XDG_CONFIG_HOME": "relative"}, "/home/me/.config/servobus/models.toml"),
        ("darwin", {}, "/home/me/Library/Application Support/servobus/models.toml"),
        ("win32", {"APPDATA": "/roaming"}, "/roaming/servobus/models.toml"),
        ("win32", {}, "/home/me/AppData/Roaming/servobus/models.toml"),
    ],
)
def test_where_the_file_is(
    monkeypatch: pytest.MonkeyPatch, system: str, variables: dict[str, str], expected: str
) -> None:
    for name in ("XDG_CONFIG_HOME", "APPDATA"):
        monkeypatch.delenv(name, raising=False)
    for name, value in variables.items():
        monkeypatch.setenv(name, value)
    monkeypatch.setattr(sys, "platform", system)
    monkeypatch.setattr(Path, "home", lambda: Path("/home/me"))
    assert place() == Path(expected)


def test_a_user_without_a_home_remembers_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    def nowhere() -> Path:
        raise RuntimeError("Could not determine home directory.")

    monkeypatch.delenv("XDG_CONFIG_HOME")
    monkeypatch.setattr(Path, "home", nowhere)
    assert Remembered("port").model(LEWANSOUL, 1, None) is None
    with pytest.raises(UsageError, match="XDG_CONFIG_HOME can name another one"):
        remember("port", "", [1], HTS35H)


# Under which name


@pytest.mark.parametrize(
    ("adapter", "name"),
    [
        (Adapter("/dev/ttyUSB0", 0x0403, 0x6001, serial_number="A5", location="1-1.2"), "0403:6001 serial number A5"),
        (
            Adapter("/dev/ttyUSB1", 0x0403, 0x6011, serial_number="A5", location="1-1.2:1.1"),
            "0403:6011 serial number A5, port 1.1",
        ),
        (Adapter("/dev/ttyUSB0", 0x1A86, 0x7523, location="1-1.2"), "1a86:7523 at 1-1.2"),
        (Adapter("/dev/ttyS0", driver="serial8250"), "/dev/ttyUSB9"),
        (None, "/dev/ttyUSB9"),
    ],
)
def test_an_adapter_has_the_name_that_stays(adapter: Adapter | None, name: str) -> None:
    assert lasting_name("/dev/ttyUSB9", adapter) == name


@pytest.mark.parametrize("port", ["socket://pi.local:3333", "rfc2217://pi.local:1", "virtual:lx16a@1", "COM4"])
def test_another_port_has_its_own_name(port: str) -> None:
    assert lasting_name(port, None) == (port if ":" in port or os.name != "posix" else str(Path(port).absolute()))


def test_no_dynamixel_is_asked_for_in_vain() -> None:
    remember("port", "", None, HTS35H)
    assert Remembered("port").model(DYNAMIXEL1, 1, None) is None
