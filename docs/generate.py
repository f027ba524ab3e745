"""Write what is made from the code: pages in docs/registers, parts of other pages, the schema of robot files.

Those parts are the rooms in docs/architecture.md, and the formats in docs/formats.md.

python docs/generate.py            write them
python docs/generate.py --check    write nothing; name the pages that are not current, exit status 1
"""

import ast
import json
import re
import sys
import tomllib
from collections.abc import Iterable, Iterator, Mapping
from enum import IntEnum
from pathlib import Path
from typing import Any

from servobus import MODELS
from servobus.cli.virtual_motors import field_word, miss_text
from servobus.cli.virtual_options import option_entries
from servobus.core.present import unit_step_text
from servobus.core.registers import Access, Area, Int, Register
from servobus.core.units import BaudDivisor, Choice, Flags, Lookup, Quantity, Switch, Thermistor, deg, rpm, show, shown
from servobus.families import registry
from servobus.families.base import Model
from servobus.families.present import differences
from servobus.robots.file import entries, schema
from servobus.robots.formats.base import listed
from servobus.robots.formats.table import FORMATS
from servobus.virtual.device.motor_set import HEAT, MotorSet
from servobus.virtual.device.motors import misses, motor_sets, supply

DOCS = Path(__file__).parent
PAGES = DOCS / "registers"
ARCHITECTURE = DOCS / "architecture.md"
FORMATS_PAGE = DOCS / "formats.md"
ROBOT = DOCS / "robot.md"
ROOT = DOCS.parent
SOURCE = ROOT / "src" / "servobus"
SCHEMA = SOURCE / "robots" / "file" / schema.FILE
BEGIN, END = "<!-- made by docs/generate.py -->", "<!-- to here -->"
"""Between these, a page has what is made here."""
FACE = "servobus"
"""The package itself: what users import."""
ROBOT_TABLES = {
    "`[robot]`": entries.RobotEntry,
    "`[port.NAME]`": entries.PortEntry,
    "`[joint.NAME]`": entries.JointEntry,
    "`[joint.NAME.mirror]`": entries.MirrorEntry,
    "`[joint.NAME.protect]`": entries.ProtectEntry,
    "`[joint.NAME.load]`": entries.LoadEntry,
    "`[motion.NAME]`": entries.MotionEntry,
    "A step in `steps` of a motion": entries.StepEntry,
}
"""Heading in robot.md -> the keys of that table."""
KGF_CM = 0.0980665
"""One kgf·cm in N·m."""
CHAPTERS = {
    "EH": "herkulex-drs-0602",
    "ED": "dynamixel-rx-28",
    "EL": "lewansoul-lx-16a",
}
"""Headings of decisions.md, as anchors."""


def main(arguments: list[str]) -> int:
    stale = []
    for name, (path, text) in files().items():
        if path.exists() and path.read_text(encoding="utf-8") == text:
            continue
        stale.append(name)
        if "--check" not in arguments:
            path.parent.mkdir(exist_ok=True)
            path.write_text(text, encoding="utf-8", newline="\n")
            print(f"wrote {stale[-1]}")
    if "--check" in arguments and stale:
        print(f"not current: {', '.join(stale)}; run `python docs/generate.py`")
        return 1
    return 0


def files() -> dict[str, tuple[Path, str]]:
    """Give every file that is made, or a part of which is: name -> path and text."""
    made = {f"docs/registers/{name}": (PAGES / name, text) for name, text in pages().items()}
    made["docs/architecture.md"] = ARCHITECTURE, architecture(ARCHITECTURE.read_text(encoding="utf-8"))
    made["docs/formats.md"] = FORMATS_PAGE, formats(FORMATS_PAGE.read_text(encoding="utf-8"))
    made["docs/robot.md"] = ROBOT, robot_page(ROBOT.read_text(encoding="utf-8"))
    made[schema.FILE] = SCHEMA, f"{json.dumps(schema.schema(), indent=2, ensure_ascii=False)}\n"
    return made


def pages() -> dict[str, str]:
    """Give every page: file name -> text."""
    texts = {"README.md": index()}
    texts |= {f"{key}.md": page(model) for key, model in MODELS.items()}
    return texts


# The index


def index() -> str:
    rows = [
        (
            f"[{model.title}]({key}.md)",
            model.series,
            model.family.title,
            model.sheet.maker,
            _default(model.register("id")),
            f"{model.factory_baud} baud",
            len(model.registers),
        )
        for key, model in ((model.key(), model) for model in registry.by_series())
    ]
    head = ("Model", "Series", "Protocol", "Maker", "Factory id", "Factory speed", "Registers")
    return _join(
        "# Registers",
        _origin("the tables in src/servobus/families"),
        "One page for each model: its specification, then every register.",
        _table(head, rows),
        "## How to read the tables",
        """\
**Where** is the place on the bus. Dynamixel: the address in the control table. HerkuleX: the address in
EEP, which survives power-off, in RAM, which acts, or in both. LewanSoul: the commands that write and
read it, and the byte among their parameters.""",
        """\
**Layout**: U8 and U16 are unsigned, S8 and S16 two's complement; "sign in bit 10" is a magnitude with the
sign in that bit. Two bytes always come low byte first.""",
        """\
**Access**: r can be read, rw can be written too, - is reserved. EEPROM survives power-off, RAM does not.""",
        """\
**Factory** and **May be written** give the raw number first, then its meaning. **Step** is what one raw
unit is worth. In Python values are SI (radians, seconds, volts, shares 0 .. 1) and °C; the pages show
degrees and percent, as the command line does.""",
        """\
A number such as ED-08 names a place where the manuals disagree; [decisions](../decisions.md) tells what is
in doubt and what servobus does. A number without the E, such as L-20, is a behaviour of the servo; the
conformance test of that number checks it.""",
    )


# One model


def page(model: type[Model]) -> str:
    parts = [f"# {model.title}", _origin(f"src/{model.__module__.replace('.', '/')}.py"), _clean(model.__doc__ or "")]
    parts += list(_differences(model))
    parts += ["## Specification", _table(("", ""), list(_sheet(model)))]
    parts += ["## Registers", _table(_HEAD, [_row(row) for row in model.registers.values()])]
    parts += ["## Second names", "Either name works."]
    parts += [_table(("Name", "Register"), [(f"`{alias}`", f"`{name}`") for alias, name in model.aliases.items()])]
    parts += list(_codes(model))
    parts += list(_motor(model))
    parts += list(_options(model))
    return _join(*parts)


def _differences(model: type[Model]) -> Iterator[str]:
    """Write what differs from the first model of the series."""
    first = next(one for one in MODELS.values() if one.family is model.family and one.series == model.series)
    if first is model:
        return
    yield f"## What differs from the {first.title}"
    rows = [(f"`{name}`", what, here, there) for name, what, here, there in differences(model, first)]
    if rows:
        yield _table(("Register", "What", model.title, first.title), rows)
    else:
        yield "The registers are the same; see the specification."


def _options(model: type[Model]) -> Iterator[str]:
    """Write the options of the model's virtual servo."""
    if rows := option_entries(model):
        yield "## Options of the virtual servo"
        yield "What real ones do in different ways, see [virtual servos](../virtual.md#what-is-known-of-real-ones)."
        head = ("Option", "In practice", "By the manual", "Values", "What it is", "Known from")
        cells = [
            (f"`{row['name']}`", row["practice"], row["manual"], row["values"], row["text"], _linked(row["decision"]))
            for row in rows
        ]
        yield _table(head, cells)


def _motor(model: type[Model]) -> Iterator[str]:
    """Write what the motor of the model's virtual servo is, and where each number comes from."""
    if not model.firmware:
        return
    sets = motor_sets(model)
    volts, sibling = supply(model)
    yield "## Motor of the virtual servo"
    yield (
        "As it is seen at the output, with the origin of each number: printed, derived from printed figures, measured "
        "on real servos, taken over from a sibling, or assumed; see [virtual servos](../virtual.md#motor-data)."
        + (f" Its supply of {volts:g} V is taken over from the {sibling}." if sibling else "")
    )
    yield _table(
        ("Number", *(f"`{name}`" for name in sets), "Unit", "Origin"),
        [row for name in _PARAMETERS for row in _parameter(name, sets)],
    )
    yield "\n".join(f"- `{name}`: {one.text}." for name, one in sets.items())
    if missed := misses(model):
        yield "Printed figures that the motor does not meet:"
        yield "\n".join(f"- {miss_text(miss)}." for miss in missed)


_PARAMETERS = {
    "gear_ratio": ("", 1.0),
    "torque_constant": ("mN·m/A", 1e3),
    "resistance": ("ohm", 1.0),
    "gear_loss": ("", 1.0),
    "coulomb": ("N·m", 1.0),
    "viscous": ("N·m·s/rad", 1.0),
    "inertia": ("kg·m²", 1.0),
    "winding_to_case": ("K/W", 1.0),
    "case_to_ambient": ("K/W", 1.0),
    "winding_capacity": ("J/K", 1.0),
    "case_capacity": ("J/K", 1.0),
}
"""Field of a motor -> unit, and how many of it make one of the field's."""


def _parameter(name: str, sets: Mapping[str, MotorSet]) -> Iterator[tuple[str, ...]]:
    """Write a number of a motor in all sets; where only some have it, the others have 0."""
    unit, factor = _PARAMETERS[name]
    if not any(name in one.origins for one in sets.values()):
        return
    origins = {str(one.origins[name]): set_name for set_name, one in reversed(sets.items()) if name in one.origins}
    told = list(reversed(origins.items()))
    text = told[0][0] if len(told) == 1 else "; ".join(f"`{set_name}` {origin}" for origin, set_name in told)
    yield (
        field_word(name) if name not in HEAT else name.replace("_", " "),
        *(_number(getattr(one.params, name) * factor) for one in sets.values()),
        unit,
        text,
    )


def _number(value: float) -> str:
    return f"{value:.0f}" if value >= 1000 else f"{value:.3g}"


def _sheet(model: type[Model]) -> Iterator[tuple[str, str]]:
    """List the specification in the units that people use."""
    sheet = model.sheet
    yield "Maker", sheet.maker
    if model.names:
        yield "Other names", ", ".join(model.names)
    yield "Protocol", f"{model.family.title}, family `{model.family.name}`"
    yield "Model number", "cannot be asked" if model.number is None else f"{model.number} ({model.number:#06x})"
    for at in sheet.performance:
        if at.stall_torque is not None:
            torque = f"{at.stall_torque:.2f} N·m ({at.stall_torque / KGF_CM:.1f} kgf·cm)"
            yield f"Stall torque at {at.voltage:g} V", torque
        if at.stall_current is not None:
            yield f"Stall current at {at.voltage:g} V", f"{at.stall_current:g} A"
        if at.speed is not None:
            speed = f"{at.speed / deg:.0f}°/s ({at.speed / rpm:.1f} rpm, {60 * deg / at.speed:.3f} s for 60°)"
            yield f"Speed without load at {at.voltage:g} V", speed
    nominal = [f"nominal {sheet.nominal_voltage:g} V"] if sheet.nominal_voltage is not None else []
    supply = [f"{sheet.voltage[0]:g} to {sheet.voltage[1]:g} V"] if sheet.voltage is not None else []
    yield "Supply", ", ".join([*supply, *nominal]) or "not known"
    yield "Angle", show(sheet.angle, "rad").replace(".0", "")
    yield "Resolution", f"{sheet.resolution / deg:.3g}°"
    if sheet.temperature is not None:
        yield "Working temperature", f"{sheet.temperature[0]:g} to {sheet.temperature[1]:g} °C"
    if sheet.standby_current is not None:
        yield "Current at rest", f"{sheet.standby_current * 1000:g} mA"
    if sheet.max_current is not None:
        yield "Highest current", f"{sheet.max_current:g} A"
    if sheet.gear_ratio is not None:
        yield "Gear", f"1 : {sheet.gear_ratio:g}" + (f", {sheet.gear}" if sheet.gear else "")
    if sheet.motor:
        yield "Motor", sheet.motor
    if sheet.weight is not None:
        yield "Weight", f"{sheet.weight * 1000:g} g"
    if sheet.size is not None:
        yield "Size", " x ".join(f"{edge * 1000:.1f}" for edge in sheet.size) + " mm"
    yield "Link", _linked(sheet.link)
    yield "Confidence", str(sheet.confidence)
    for remark in sheet.remarks:
        yield "Remark", _linked(remark)


_HEAD = ("Register", "Where", "Layout", "Access", "Factory", "May be written", "Step", "Meaning")


def _row(row: Register[Any]) -> tuple[str, ...]:
    meaning = row.meaning + (f" ({_linked(row.note)})" if row.note else "")
    kept = "EEPROM" if row.area is Area.EEPROM else "RAM"
    access = f"{row.access.value}, {kept}"
    return (
        f"`{row.name}`",
        row.place.text(),
        _layout(row.layout),
        access,
        _default(row),
        _limits(row),
        _step(row),
        meaning,
    )


def _layout(layout: Int) -> str:
    if layout.sign_bit is not None:
        return f"{layout.size} bytes, sign in bit {layout.sign_bit}"
    return f"{'S' if layout.signed else 'U'}{8 * layout.size}{', high byte first' if layout.order == 'big' else ''}"


def _meaning(row: Register[Any], raw: int) -> str:
    """Write what a raw value means."""
    return row.show(row.decode(raw))


def _say(row: Register[Any], raw: int) -> str:
    """Write a raw value with what it means, if that says more."""
    try:
        meaning = _meaning(row, raw)
    except ValueError:
        return str(raw)
    return str(raw) if meaning == str(raw) else f"{raw} = {meaning}"


def _default(row: Register[Any]) -> str:
    return "" if row.default is None else _say(row, row.default)


def _limits(row: Register[Any]) -> str:
    if row.access is not Access.READ_WRITE:
        return ""
    if row.allowed is not None:
        return ", ".join(str(raw) for raw in row.allowed)
    low, high = row.limits
    if isinstance(row.scale, Choice | Flags | Switch):
        return f"{low} .. {high}"
    text = f"{low} .. {high}"
    meaning = f"{_meaning(row, low)} .. {_meaning(row, high)}"
    return text if meaning == text else f"{text} = {meaning}"


def _step(row: Register[Any]) -> str:
    """Tell what one raw unit is worth, or which table of names holds."""
    match row.scale:
        case Choice(options) | Flags(options):
            return f"[{options.__name__}](#{options.__name__.lower()})"
        case Switch(on):
            return f"{on} is on"
        case BaudDivisor() | Lookup():
            return "[speed code](#bus-speeds)"
    if isinstance(row.scale, Thermistor):
        return unit_step_text(row)
    if not isinstance(row.scale, Quantity):
        return f"1 {row.unit}" if row.unit else "1"
    if row.unit == "s" and row.scale.step < 1e-4:
        return _meaning(row, 1)
    if row.unit in ("", "pwm per position unit"):
        return f"1/{1 / row.scale.step:g} {row.unit}".strip()
    value, symbol = shown(row.scale.step, row.unit)
    return f"{value:.4g}{'' if symbol in ('', '°', '°/s') else ' '}{symbol}"


def _codes(model: type[Model]) -> Iterator[str]:
    """Write the names of bits, choices and speed codes that the registers use."""
    users: dict[Any, list[str]] = {}
    for row in model.registers.values():
        if isinstance(row.scale, Choice | Flags):
            members = row.scale.used if isinstance(row.scale, Flags) else tuple(row.scale.options)
            users.setdefault((row.scale.options, members), []).append(f"`{row.name}`")
    for (options, members), names in users.items():
        yield f"## {options.__name__}"
        kind = "One of these" if issubclass(options, IntEnum) else "Any of these bits"
        yield f"{kind}, in {', '.join(names)}. {_linked(_clean(options.__doc__ or ''))}"
        rows = [(f"{option:d}", f"{option:#04x}", f"`{option.name.lower()}`") for option in members]
        yield _table(("Raw", "Hex", "Name"), rows)
    baud = model.optional("baud")
    if baud is None:
        return
    yield "## Bus speeds"
    yield f"Codes of `{baud.name}` for the usual speeds."
    codes = sorted((baud.encode(speed), speed) for speed in model.bauds)
    rows = [(str(code), str(speed), f"{baud.decode(code)}") for code, speed in codes]
    yield _table(("Code", "Speed, bit/s", "As the servo has it"), rows)


# Markdown


def _origin(source: str) -> str:
    return f"<!-- Written by docs/generate.py from {source}; do not edit. -->"


def _linked(text: str) -> str:
    """Turn the numbers of decisions into links."""
    return re.sub(r"\b(E[HDL])-\d\d\b", lambda match: f"[{match[0]}](../decisions.md#{CHAPTERS[match[1]]})", text)


def _clean(text: str) -> str:
    return "\n".join(line.strip() for line in text.strip().splitlines())


def _table(head: tuple[str, ...], rows: list[Any]) -> str:
    def line(cells: tuple[Any, ...]) -> str:
        return "| " + " | ".join(str(cell).replace("|", r"\|") for cell in cells) + " |"

    return "\n".join([line(head), line(("---",) * len(head)), *map(line, rows)])


def _join(*parts: str) -> str:
    return "\n\n".join(parts) + "\n"


# The rooms


def robot_page(text: str) -> str:
    """Put the keys of a robot file into the page about robots."""
    tables = []
    for head, entry in ROBOT_TABLES.items():
        rows = [(f"`{name}`", _needed(key), key.about) for name, key in entries.keys_of(entry).items()]
        tables += [f"### {head}", _table(("Key", "", "What it is"), rows)]
    tables.append("`[group]` has names of joints by name of the group, `[pose.NAME]` angles by joint.")
    return _with(text, "\n\n".join(table.strip() for table in tables))


def _needed(key: entries.Key) -> str:
    """Say whether a key is needed, or show how its value is written."""
    example = next(iter(key.kind.schema().get("examples", [])), "")
    shown = f"`{json.dumps(example, ensure_ascii=False)}`" if example else ""
    return " ".join(word for word in ("needed" if key.required else "", shown) if word)


def architecture(text: str) -> str:
    """Give architecture.md with its picture and table made anew."""
    return _with(text, f"{layer_picture()}\n\n{room_table()}")


def formats(text: str) -> str:
    """Give formats.md with its table made anew."""
    head = ("Format", "What it is", "Out", "In", "What is carried over", "What such a file cannot say")
    rows = [
        (
            f"`{one.name}`",
            one.title.replace("<", "`<").replace(">", ">`"),
            "yes" if one.write else "",
            listed(["a new robot file"] * bool(one.new) + ["onto a robot file"] * bool(one.onto)),
            one.holds,
            one.lacks,
        )
        for one in FORMATS.values()
    ]
    return _with(text, _table(head, rows))


def _with(text: str, made: str) -> str:
    """Give a page with what is made here between its two marks."""
    before, _, rest = text.partition(BEGIN)
    _, _, behind = rest.partition(END)
    return f"{before}{BEGIN}\n\n{made}\n\n{END}{behind}"


def layers(contract: str = "rooms") -> list[list[str]]:
    """Give the rooms of a contract, the highest first; those beside each other do not import each other."""
    options = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["tool"]["importlinter"]
    (rows,) = (one["layers"] for one in options["contracts"] if one["id"] == contract)
    rooms = [[room.strip() for room in row.split("|")] for row in rows]
    return [[room for room in row if not room.startswith("(")] for row in rooms]


def layer_picture() -> str:
    """Draw the layers."""
    lines = [" | ".join(row) for row in layers()]
    return "\n".join(["```", *(line.center(30).rstrip() for line in lines), "```"])


def room_table() -> str:
    """List each room, what it holds and what it imports of ours."""
    rows = ["| room | what it holds | imports |", "|---|---|---|"]
    for layer in layers():
        for room in layer:
            used = imports(room)
            listed = [f"`{one}`" for one in [*(one for row in layers() for one in row), FACE] if one in used]
            rows.append(f"| `{room}` | {purpose(room)} | {', '.join(listed) or 'nothing'} |")
    return "\n".join(rows)


def purpose(room: str) -> str:
    """Give the first paragraph of a room's docstring."""
    package, module = SOURCE / room / "__init__.py", SOURCE / f"{room}.py"
    tree = ast.parse((package if package.exists() else module).read_text(encoding="utf-8"))
    said = (ast.get_docstring(tree) or "").split("\n\n")[0]
    if not said:
        raise ValueError(f"{room} has no docstring that says what it holds")
    return " ".join(said.split())


def imports(room: str) -> set[str]:
    """Give the other rooms that a room imports, inside functions too.

    Firmware, control laws and motors of a family are left out: they run inside virtual servos.
    """
    files = [SOURCE / f"{room}.py"] if (SOURCE / f"{room}.py").exists() else sorted((SOURCE / room).rglob("*.py"))
    used: set[str] = set()
    for file in files:
        if room != "families" or file.stem not in ("firmware", "answering", "control", "motors"):
            used |= set(_imported(ast.walk(ast.parse(file.read_text(encoding="utf-8")))))
    return used - {room}


def _imported(nodes: Iterable[ast.AST]) -> Iterable[str]:
    for node in nodes:
        names: list[str] = []
        if isinstance(node, ast.ImportFrom) and node.module:
            names = [node.module] + [f"{node.module}.{alias.name}" for alias in node.names]
        elif isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        yield from (name.split(".")[1] for name in names if name.startswith("servobus."))
        yield from (FACE for name in names if name == FACE)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
