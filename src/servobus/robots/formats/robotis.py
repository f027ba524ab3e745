"""The .robot file of the ROBOTIS framework: ports and devices, in columns.

    [ port info ]
    # PORT NAME    | BAUDRATE | DEFAULT JOINT
    /dev/ttyUSB0   | 1000000  | pan
    [ device info ]
    # TYPE    | PORT NAME    | ID | MODEL | PROTOCOL | DEV NAME | BULK READ ITEMS
    dynamixel | /dev/ttyUSB0 | 1  | MX-28 | 1.0      | pan      | present_position

A line with another number of columns is passed over there, and told of here. The framework counts angles from the
middle of a servo (value_of_0_radian_position in MODEL.device, 2048 of an MX-28) and adds what an offset file says; it
has no sign. Source: ROBOTIS-Framework, robotis_device/src/robotis_device/robot.cpp and devices/dynamixel/MX-28.device.
"""

import re
from collections.abc import Iterator
from typing import Any, NamedTuple

from servobus.core.ids import LAST_ID
from servobus.core.units import deg
from servobus.errors import FormatError, UnknownName
from servobus.families import registry
from servobus.families.model import Model
from servobus.robots.file.entries import RobotFile
from servobus.robots.file.kinds import shown
from servobus.robots.file.writing import quantity
from servobus.robots.formats.base import Draft, Given, Noted, Written, added, listed, plain_name, text_of
from servobus.robots.formats.servos import DYNAMIXEL, NamedServo, dynamixels, middle, one_speed, port_notes, rounded

PROTOCOL = "1.0"
CYCLE = 8
"""ms: control_cycle of the framework, as it comes with its robots."""
READ = "present_position"
LACKS = (
    "A .robot file has no zero, direction, limits and gear of a joint: `servobus robot calibrate` finds them.",
    "Where the framework had an offset file, add its angle to the zero.",
)
_SECTION = re.compile(r"\[\s*([\w ]+?)\s*\]")


class _Port(NamedTuple):
    path: str
    baud: int


class _Device(NamedTuple):
    kind: str
    port: str
    id: str
    model: str
    protocol: str
    name: str


def known(data: bytes) -> bool:
    """Tell whether a file is a .robot file."""
    return re.search(rb"^\s*\[\s*device info\s*\]", data, re.MULTILINE) is not None


def write(file: RobotFile) -> Written:
    """Make a .robot file, of the Dynamixel servos of a robot."""
    mine, left = dynamixels(file, "the ROBOTIS framework")
    ports = dict.fromkeys(one.servo.port for one in mine)
    lines = ["[ control info ]", f"control_cycle = {CYCLE}   # ms", "", "[ port info ]"]
    lines += ["# PORT NAME | BAUDRATE | DEFAULT JOINT"]
    for port in ports:
        there = [one for one in mine if one.servo.port == port]
        lines.append(f"{file.ports[port].path} | {one_speed(file, port, there)} | {there[0].name}")
    lines += ["", "[ device info ]", "# TYPE | PORT NAME | ID | MODEL | PROTOCOL | DEV NAME | BULK READ ITEMS"]
    for one in mine:
        where = file.ports[one.servo.port].path
        model = one.servo.model.title
        lines.append(f"{DYNAMIXEL} | {where} | {one.servo.id} | {model} | {PROTOCOL} | {one.name} | {READ}")
    return Written("\n".join(lines) + "\n", (*left, *_notes(file, mine)))


def _notes(file: RobotFile, mine: list[NamedServo]) -> Iterator[str]:
    if turned := [one.name for one in mine if one.servo.axis.direction < 0]:
        yield f"the framework has no sign, so these turn the other way there: {listed(turned)}"
    shifts = [(one, one.servo.axis.zero - middle(one.servo.model, file.name)) for one in mine]
    if shifted := [f"{one.name} {shift:.4f}" for one, shift in shifts if abs(shift) > 0.1 * deg]:
        yield f"the framework counts from the middle of a servo; offsets for its offset file, rad: {listed(shifted)}"
    if geared := [one.name for one in mine if one.servo.axis.ratio != 1]:
        yield f"the framework knows no gear, so its angles are those of the servo: {listed(geared)}"
    models = listed(dict.fromkeys(f"{one.servo.model.title}.device" for one in mine))
    yield f"the framework reads limits and control tables from a file per model, which it needs: {models}"
    yield from port_notes(file, (one.servo.port for one in mine))


def new(data: bytes, given: Given) -> Draft:
    """Make a robot file out of a .robot file."""
    source = given.source
    found, devices, notes = _read(text_of(data, source), source)
    ports: dict[str, dict[str, Any]] = {}
    joints: dict[str, dict[str, Any]] = {}
    left = []
    for device in devices:
        model = _model(device)
        if model is None:
            left.append(f"{device.name} ({device.model}, protocol {device.protocol})")
            continue
        port = plain_name(device.port)
        path = given.port(port) or device.port
        if ports.setdefault(port, {"path": path})["path"] != path:
            raise FormatError(f"{source}: two of its ports would be called {port} in a robot file; rename one of them")
        if not device.id.isdecimal() or int(device.id) > LAST_ID:
            raise FormatError(f"{source}: the id of {shown(device.name)} is {shown(device.id)}; ids are 0 to {LAST_ID}")
        there = found.get(device.port)
        zero = rounded(middle(model, source))
        values = {
            "port": port,
            "model": model.key(),
            "id": int(device.id),
            "baud": there.baud if there else Noted(None, f"{device.port} is not in [port info], so its speed is open"),
            "zero": Noted(quantity(zero, "rad"), "the middle of the servo, from which the framework counts"),
        }
        added(joints, given.joint(device.name), values, source)
    if left:
        notes.append(f"servobus does not drive these, so they are left out: {listed(left)}.")
    if not joints:
        raise FormatError(f"{source}: there is no Dynamixel servo of protocol 1.0 in it that servobus drives")
    return Draft("a .robot file of the ROBOTIS framework", ports, joints, {}, LACKS, tuple(notes))


def _read(text: str, source: str) -> tuple[dict[str, _Port], list[_Device], list[str]]:
    ports: dict[str, _Port] = {}
    devices: list[_Device] = []
    notes: list[str] = []
    section = ""
    for number, whole in enumerate(text.splitlines(), 1):
        line = whole.split("#", 1)[0].strip()
        if match := _SECTION.fullmatch(line):
            section = match[1].lower()
        elif line and section in ("port info", "device info"):
            columns = [column.strip() for column in line.split("|")]
            wanted = 3 if section == "port info" else 7
            if len(columns) != wanted:
                notes.append(
                    f"Line {number} has {len(columns)} columns instead of {wanted}, so the framework passes over it."
                )
            elif section == "device info":
                devices.append(_Device(*columns[:6]))
            elif not columns[1].isdecimal() or int(columns[1]) == 0:
                raise FormatError(f"{source}:{number}: {shown(columns[1])} is no speed in bit/s")
            else:
                ports[columns[0]] = _Port(columns[0], int(columns[1]))
    if not devices:
        raise FormatError(f"{source}: a .robot file has a section [ device info ] with devices, and this has none")
    return ports, devices, notes


def _model(device: _Device) -> type[Model] | None:
    """Find the model of a device; None if it is none that is driven here."""
    if device.kind.lower() != DYNAMIXEL or device.protocol != PROTOCOL:
        return None
    try:
        model = registry.model(device.model)
    except UnknownName:
        return None
    return None if model.generic or model.family.name != DYNAMIXEL else model
