"""The import contracts in pyproject.toml hold, and each fails where an import breaks it.

The graph of imports is built once; a violation is one import more in a copy of it. The last test does it with files.
"""

import shutil
import subprocess
import sys
import tomllib
from copy import deepcopy
from pathlib import Path
from typing import Any

import grimp
import pytest
from importlinter.application.use_cases import read_user_options
from importlinter.configuration import configure
from importlinter.contracts.acyclic_siblings import AcyclicSiblingsContract
from importlinter.contracts.forbidden import ForbiddenContract
from importlinter.contracts.layers import LayersContract
from importlinter.contracts.protected import ProtectedContract
from importlinter.domain.contract import Contract

ROOT = Path(__file__).parents[2]
TYPES: dict[str, type[Contract]] = {
    "acyclic_siblings": AcyclicSiblingsContract,
    "forbidden": ForbiddenContract,
    "layers": LayersContract,
    "protected": ProtectedContract,
}
CONTRACTS = {
    one["id"]: one for one in tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["importlinter"]["contracts"]
}
FAMILIES = ("dynamixel", "herkulex", "lewansoul")

VIOLATIONS = [
    # Downwards only. An import that goes through the package itself counts as well.
    ("rooms", "errors", "core.values"),
    ("rooms", "core.exchange", "transports.base"),
    ("rooms", "core.exchange", "families.base"),
    ("rooms", "transports.base", "core.framing"),
    ("rooms", "transports.tap", "traffic.recording"),
    ("rooms", "families.base", "link.link"),
    ("rooms", "families.dynamixel.firmware.servo", "link.link"),
    ("rooms", "link.link", "families.base"),
    ("rooms", "link.link", "jobs.scan"),
    ("rooms", "families.dynamixel.verbs", "jobs.move"),
    ("rooms", "families.dynamixel.verbs", "virtual.device.memory"),
    ("rooms", "jobs.scan", "traffic.tracker"),
    ("rooms", "traffic.tracker", "jobs.scan"),
    ("rooms", "jobs.scan", "safety.safe_stop"),
    ("rooms", "safety.safe_stop", "bus.base"),
    ("rooms", "safety.safe_stop", "virtual.serve.rig"),
    ("rooms", "bus.blocking", "virtual.serve.inprocess"),
    ("rooms", "virtual.serve.inprocess", "bus.blocking"),
    ("rooms", "bus.base", "connect"),
    ("rooms", "virtual.serve.rig", "connect"),
    ("rooms", "connect", "doctor.port"),
    ("rooms", "doctor.health", "cli.output"),
    ("rooms", "pytest_plugin", "cli.options"),
    ("rooms", "cli.output", "pytest_plugin"),
    ("rooms", "remote.link", "bus.base"),
    ("rooms", "jobs.scan", "remote.link"),
    ("rooms", "link.link", "remote.steps"),
    ("rooms", "robots.ports", "server.ports.gate"),
    ("rooms", "server.ports.service", "cli.output"),
    ("rooms", "bus.base", ""),
    ("rooms", "core.exchange", ""),
    *[
        ("families", f"families.{one}.verbs", f"families.{other}.protocol")
        for one in FAMILIES
        for other in FAMILIES
        if one != other
    ],
    ("remote", "remote.messages", "remote.port"),
    ("remote", "remote.protocol", "remote.link"),
    ("remote", "remote.port", "remote.session"),
    ("server", "server.ports.service", "server.web.app"),
    ("server", "server.web.app", "server.ports.service"),
    ("families", "families.dynamixel.firmware.servo", "families.herkulex.firmware.servo"),
    # What all firmware is built on finds a family's by name, when a servo is made: else one would import the others.
    ("families", "virtual.device.servo", "families.dynamixel.firmware"),
    ("families", "families.dynamixel.verbs", "families.registry"),
    ("families", "families.base", "families.registry"),
    ("families", "families.base", "families.dynamixel.verbs"),
    ("families", "families.base", "families.explain"),
    ("families", "families.model", "families.registry"),
    ("families", "families.explain", "families.present"),
    ("families", "families.record", "families.base"),
    ("families", "families.stopping", "families.base"),
    ("families", "families.stopping", "families.change"),
    ("families", "families.motion", "families.stopping"),
    ("families", "families.target", "families.motion"),
    ("families", "families.model", "families.target"),
    ("families", "families.reading", "families.model"),
    *[("family", f"families.{one}.protocol", f"families.{one}.verbs") for one in FAMILIES],
    *[("family", f"families.{one}.verbs", f"families.{one}.firmware") for one in FAMILIES],
    ("family", "families.dynamixel.verbs", "families.dynamixel.models.rx28"),
    ("family", "families.herkulex.protocol", "families.herkulex.listening"),
    ("family", "families.herkulex.places", "families.herkulex.verbs"),
    ("family", "families.herkulex.protocol", "families.herkulex.places"),
    *[("family", f"families.{one}.listening", f"families.{one}.verbs") for one in FAMILIES],
    ("family", "families.herkulex.maps", "families.herkulex.verbs"),
    ("family", "families.herkulex.maps", "families.herkulex.listening"),
    ("packets", "families.dynamixel.protocol", "families.base"),
    ("packets", "families.lewansoul.protocol", "families.model"),
    ("packets", "families.herkulex.protocol", "transports.base"),
    # The driver's side of a family never imports what runs inside a virtual servo.
    *[
        ("firmware", f"families.{one}.{module}", f"families.{one}.{inside}")
        for one in FAMILIES
        for module in ("protocol", "listening", "verbs", "models")
        for inside in ("firmware", "control", "motors")
    ],
    ("firmware", "families.herkulex.verbs", "families.herkulex.firmware.answering"),
    ("firmware", "families.registry", "families.dynamixel.firmware"),
    ("firmware", "jobs.scan", "families.dynamixel.firmware"),
    ("firmware", "bus.servo", "families.lewansoul.control"),
    ("firmware", "cli.step", "families.dynamixel.motors"),
    ("robots", "robots.axis", "robots.joints.joint"),
    ("robots", "robots.joints.joint", "robots.base"),
    ("robots", "robots.motions.play", "robots.settings.planning"),
    ("trajectory", "robots.trajectory.path", "bus.servo"),
    ("virtual", "families.dynamixel.verbs", "virtual.device.servo"),
    ("virtual", "families.herkulex.protocol", "virtual.physics.motor"),
    ("virtual", "families.base", "virtual.device.servo"),
    ("virtual", "cli.sniff", "virtual.serve.ports"),
    ("virtual", "cli.scan", "virtual.serve.inprocess"),
    ("virtual", "doctor.port", "virtual.serve.inprocess"),
    ("virtual-rooms", "virtual.physics.motor", "virtual.device.memory"),
    ("virtual-rooms", "virtual.device.servo", "virtual.wire.line"),
    ("virtual-rooms", "virtual.wire.line", "virtual.serve.rig"),
    ("physics", "virtual.physics.motor", "errors"),
    ("physics", "virtual.physics.shaft", "core.units"),
    ("physics", "virtual.physics.shaft", "families.dynamixel.models.rx28"),
    ("physics", "virtual.physics.trajectory", "virtual.device.memory"),
    ("physics", "virtual.physics.trajectory", ""),
    *[("physics", f"families.{one}.control", "core.units") for one in FAMILIES],
    ("physics", "families.dynamixel.control", "families.dynamixel.protocol"),
    ("physics", "families.dynamixel.control", "families.base"),
    ("physics", "families.herkulex.control", "families.lewansoul.control"),
    ("physics", "families.herkulex.control", "virtual.device.memory"),
    ("circles", "virtual.wire.injector", "virtual.wire.line"),
    ("circles", "link.stats", "link.link"),
    ("circles", "core.values", "core.units"),
    ("clock", "core.exchange", "~time"),
    ("clock", "families.stopping", "~time"),
    ("clock", "families.dynamixel.protocol", "~serial"),
    ("clock", "families.herkulex.verbs", "~time"),
    ("clock", "families.lewansoul.models.lx", "~socket"),
    ("clock", "jobs.move", "~time"),
    ("clock", "jobs.scan", "~asyncio"),
    ("clock", "traffic.tracker", "~threading"),
    ("terminal", "core.present", "~click"),
    ("terminal", "traffic.present", "~rich"),
    ("terminal", "doctor.health", "~rich"),
    ("terminal", "bus.cycle", "~matplotlib"),
    ("web", "cli.output", "~fastapi"),
    ("web", "connect", "~uvicorn"),
]
"""Contract, module and what that must not import; both inside servobus, or ~ and a package of others."""

ALLOWED = [
    ("families.dynamixel.firmware.servo", "virtual.device.memory"),
    ("families.dynamixel.control", "virtual.physics.motor"),
    ("families.dynamixel.motors", "virtual.physics.motor"),
    ("virtual.serve.rig", "families.dynamixel.firmware"),
    ("virtual.device.servo", "families.base"),
    ("families.record", "~time"),
    ("link.link", "~time"),
    ("cli.info", "~rich"),
    ("cli.step", "virtual.physics.motor"),
    ("doctor.losses", "traffic.tracker"),
]
"""What no contract forbids."""


@pytest.fixture(scope="module")
def graph() -> grimp.ImportGraph:
    return grimp.build_graph("servobus", include_external_packages=True, cache_dir=None)


def contract(id: str) -> Contract:
    configure()
    options = read_user_options(str(ROOT / "pyproject.toml"))
    (mine,) = (one for one in options.contracts_options if one["id"] == id)
    return TYPES[mine["type"]](mine["name"], options.session_options, mine)


def is_kept(id: str, graph: grimp.ImportGraph) -> bool:
    return contract(id).check(deepcopy(graph), verbose=False).kept


def with_import(graph: grimp.ImportGraph, importer: str, imported: str) -> grimp.ImportGraph:
    source = f"servobus.{importer}"
    target = imported[1:] if imported.startswith("~") else f"servobus.{imported}".rstrip(".")
    assert source in graph.modules
    assert target in graph.modules or imported.startswith("~")
    assert not graph.direct_import_exists(importer=source, imported=target), "this import is there already"
    changed = deepcopy(graph)
    if target not in changed.modules:
        changed.add_module(target, is_squashed=True)
    changed.add_import(importer=source, imported=target, line_number=1, line_contents=f"import {target}")
    return changed


@pytest.mark.parametrize("id", CONTRACTS)
def test_a_contract_is_kept(id: str, graph: grimp.ImportGraph) -> None:
    assert is_kept(id, graph)


@pytest.mark.parametrize(("id", "importer", "imported"), VIOLATIONS)
def test_a_violation_breaks_the_contract(id: str, importer: str, imported: str, graph: grimp.ImportGraph) -> None:
    assert not is_kept(id, with_import(graph, importer, imported))


@pytest.mark.parametrize(("importer", "imported"), ALLOWED)
def test_what_is_allowed_breaks_none(importer: str, imported: str, graph: grimp.ImportGraph) -> None:
    source, target = f"servobus.{importer}", imported[1:] if imported.startswith("~") else f"servobus.{imported}"
    if not graph.direct_import_exists(importer=source, imported=target):
        graph = with_import(graph, importer, imported)
    assert [id for id in CONTRACTS if not is_kept(id, graph)] == []


def test_the_one_import_that_runs_upwards_is_for_type_checkers_alone() -> None:
    running = grimp.build_graph("servobus", exclude_type_checking_imports=True, cache_dir=None)
    assert not running.direct_import_exists(importer="servobus.families.model", imported="servobus.families.base")


def test_every_contract_has_a_violation_here() -> None:
    assert {id for id, _, _ in VIOLATIONS} == set(CONTRACTS)


def layers() -> list[list[str]]:
    rows: list[Any] = CONTRACTS["rooms"]["layers"]
    return [[room.strip() for room in row.split("|") if "(" not in room] for row in rows]


def modules_of(room: str, graph: grimp.ImportGraph) -> str:
    """Give a module that stands for a room."""
    inside = sorted(graph.find_descendants(f"servobus.{room}"))
    return inside[-1].removeprefix("servobus.") if inside else room


def test_no_room_imports_one_above_or_beside_it(graph: grimp.ImportGraph) -> None:
    rows = layers()
    for place, row in enumerate(rows):
        for room in row:
            forbidden = [one for above in rows[:place] for one in above] + [one for one in row if one != room]
            for other in forbidden:
                importer, imported = modules_of(room, graph), modules_of(other, graph)
                if room == "families":  # firmware, the last of its modules, may import virtual servos
                    importer = "families.base"
                assert not is_kept("rooms", with_import(graph, importer, imported)), f"{importer} imports {imported}"


@pytest.mark.parametrize("module", ["servobus.attic", "servobus.families.attic", "servobus.virtual.attic"])
def test_a_new_room_needs_a_place(module: str, graph: grimp.ImportGraph) -> None:
    changed = deepcopy(graph)
    changed.add_module(module)
    broken = [id for id in ("rooms", "families", "virtual-rooms") if not is_kept(id, changed)]
    assert len(broken) == 1


def test_the_command_says_which_contract_is_broken(tmp_path: Path) -> None:
    shutil.copytree(ROOT / "src" / "servobus", tmp_path / "servobus", ignore=shutil.ignore_patterns("__pycache__"))
    shutil.copy(ROOT / "pyproject.toml", tmp_path)
    with (tmp_path / "servobus" / "bus" / "blocking.py").open("a") as file:
        file.write("\nfrom servobus.virtual.serve.inprocess import VirtualPort\n")
    code = "import sys; from importlinter.cli import lint_imports_command; lint_imports_command()"
    command = [sys.executable, "-c", code, "--no-cache", "--no-logo", "--contract", "rooms", "--contract", "family"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 1, done.stdout
    said = " ".join(done.stdout.split())
    assert f"{CONTRACTS['rooms']['name']} BROKEN" in said
    assert f"{CONTRACTS['family']['name']} KEPT" in said
    assert "servobus.bus.blocking -> servobus.virtual.serve.inprocess" in said
