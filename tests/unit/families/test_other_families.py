"""A family of another distribution is used like a built-in one: no file of src/servobus knows its name."""

import json
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from click.testing import CliRunner

import servobus
from servobus import UnknownName, UsageError, deg
from servobus.cli.app import app
from servobus.families import registry
from servobus.families.dynamixel.verbs import Dynamixel1
from toyfamily.models import TOY1
from toyfamily.protocol import write
from toyfamily.verbs import TOY

SPEC = "virtual:toy1@1,rx28@1?clock=virtual"


@pytest.fixture
def bare_registry(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Let the registry know the built-in models alone, and what a test adds; afterwards all is as it was."""
    models, families = dict(registry.MODELS.entries), dict(registry.FAMILIES.entries)
    monkeypatch.setattr(registry, "_loaded", False)
    yield
    for known, entries in ((registry.MODELS, models), (registry.FAMILIES, families)):
        known.entries.clear()
        known.entries.update(entries)  # type: ignore[arg-type] # each its own


def install(monkeypatch: pytest.MonkeyPatch, place: Path, value: str) -> None:
    """Install a distribution with this entry point, as far as Python can tell."""
    info = place / "toys-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: toys\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text(f"[{registry.GROUP}]\ntoy = {value}\n")
    monkeypatch.syspath_prepend(place)


@pytest.fixture
def toys(bare_registry: None, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    install(monkeypatch, tmp_path, "toyfamily:MODELS")


def run(*args: str | int) -> str:
    """Run a command that does what it should, and give what it prints."""
    result = CliRunner().invoke(app, [str(arg) for arg in args], prog_name="servobus")
    assert result.exit_code == 0, result.output
    return result.stdout


@pytest.mark.usefixtures("toys")
def test_it_is_driven_like_any_other() -> None:
    with servobus.open(SPEC) as bus:
        toy, other = sorted(bus.scan(ids=range(3)), key=lambda servo: servo.model.title, reverse=True)
        assert (toy.model, toy.id, toy.baud, other.model.title) == (TOY1, 1, 38_400, "RX-28")
        assert str(toy) == "Toy-1 id 1 at 38400: 180.0°, 6.0 V, 25 °C, torque off"
        with toy.torque():
            toy.move(90 * deg, time=1.0).wait()
            assert toy.read(TOY1.present_position) == pytest.approx(90 * deg, abs=1 * deg)
            other.torque_on()
            bus.move({toy: 120 * deg, other: 120 * deg}, time=0.5).wait()
        toy.write(TOY1.max_position, 200 * deg)
        with pytest.raises(servobus.BadValue, match="outside the limits set in it"):
            toy.start_move(201 * deg)
        saved = toy.backup()
        assert saved.values["highest"] == 2000
        assert servobus.Backup.parse(saved.text()) == saved
        toy.change_id(9)
        toy.reset()
        assert toy.id == 1
        assert toy.read(TOY1.max_position) == pytest.approx(360 * deg)
        with pytest.raises(UsageError, match="is not a register of Toy-1"):
            toy.read(servobus.RX28.goal_position)


@pytest.mark.usefixtures("toys")
def test_its_alarms_are_told() -> None:
    with servobus.open("virtual:toy1@1?clock=virtual&temperature=80") as bus:
        assert "ALARM hot" in str(bus.find(1))


@pytest.mark.usefixtures("toys")
def test_the_command_line_knows_it() -> None:
    port = "virtual:toy1@1?clock=virtual"
    assert "Toy-1 id 1 at 38400" in run("scan", port, "--ids", "0-2", "--family", "toy")
    assert json.loads(run("read", port, 1, "present_position", "--json"))["present_position"]["value"] == 180.0
    assert "toy1" in run("models")
    assert json.loads(run("registers", "toy1", "goal_position", "--json"))[0]["cell"] == 8
    assert "cell 8, 2 bytes" in run("registers", "toy1", "goal_position")
    assert "dynamixel, herkulex, lewansoul or toy servos" in " ".join(run("read", "--help").split())
    assert "speed: toy at 38400" in run("doctor", port, "--family", "toy", "--ids", "0-2", "--reads", 20)


@pytest.mark.usefixtures("toys")
def test_its_packets_are_explained() -> None:
    packet = write(1, 8, (900).to_bytes(2)).request
    assert "WRITE id 1: goal_position 90.0°" in run("decode", "--family", "toy", packet.hex())
    assert "WRITE id 1: goal_position 90.0°" in run("decode", packet.hex())


@pytest.mark.usefixtures("toys")
def test_a_name_that_is_unknown_lists_it_too() -> None:
    with pytest.raises(UnknownName, match="did you mean toy1"):
        registry.model("toy-2")
    assert registry.family("toy") is TOY
    assert registry.factory_bauds(TOY) == (38_400,)


@pytest.mark.usefixtures("bare_registry")
@pytest.mark.parametrize("value", ["nowhere:MODELS", "toyfamily:NOTHING", "toyfamily.models:Model"])
def test_one_that_cannot_be_used_is_left_out_with_a_word(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, value: str
) -> None:
    install(monkeypatch, tmp_path, value)
    with pytest.warns(UserWarning, match="servo family toy .* is left out"):
        assert len(registry.FAMILIES) == 3
    assert "rx28" in registry.MODELS


@pytest.mark.usefixtures("bare_registry")
def test_a_name_that_is_taken_is_refused_and_changes_nothing() -> None:
    class Other(TOY1):
        title = "RX-28"

    with pytest.raises(UsageError, match="there is a model rx28 already"):
        registry.add(TOY1, Other)
    assert "toy1" not in registry.MODELS

    class Strange(servobus.RX28):
        title = "Strange"
        family = Dynamixel1()

    with pytest.raises(UsageError, match="another family dynamixel"):
        registry.add(Strange)

    class Parent(TOY1):
        pass

    with pytest.raises(UsageError, match="a model has a title of its own"):
        registry.add(Parent)


def test_what_is_installed_is_read_only_if_there_is_something_for_us() -> None:
    script = (
        "import sys, servobus\n"
        "with servobus.open('virtual:rx28@1?clock=virtual') as bus:\n"
        "    bus.scan(ids=[1])\n"
        "assert servobus.families.registry._loaded\n"
        "assert 'importlib.metadata' not in sys.modules\n"
    )
    subprocess.run([sys.executable, "-c", script], check=True)
    script = "import servobus\nassert not servobus.families.registry._loaded\n"
    subprocess.run([sys.executable, "-c", script], check=True)


@pytest.mark.usefixtures("bare_registry")
def test_a_path_that_is_not_there_or_is_an_archive(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(sys, "path", [str(tmp_path / "nowhere"), str(tmp_path)])
    assert not registry._mentioned()
    (tmp_path / "some.zip").write_bytes(b"")
    monkeypatch.setattr(sys, "path", [str(tmp_path / "some.zip")])
    assert registry._mentioned()


def test_no_file_of_servobus_knows_its_name() -> None:
    source = Path(servobus.__file__).parent
    assert not [path for path in source.rglob("*.py") if "toyfamily" in path.read_text()]
