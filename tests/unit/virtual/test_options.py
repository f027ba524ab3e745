"""Options of virtual servos: how they are said, that each has an effect, and that the driver gets along with all."""

import re
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import pytest

from conformance.wire import Wire, dxl, lx
from samples import every_model, turning
from servobus import LX16A, MODELS, RX28, Bus, UsageError, deg
from servobus.errors import BadValue
from servobus.families.base import Model
from servobus.virtual.device.options import READINGS, Limit, OneOf, OnOff, Option, Span, Times, defaults, options_of
from servobus.virtual.device.servo import VirtualServo, firmware, virtual_servo
from servobus.virtual.physics.motor import Load
from servobus.virtual.serve.inprocess import VirtualPort, connect
from servobus.virtual.serve.rig import build_rig
from servobus.virtual.serve.spec import Group, Setup, parse_specs, parse_url

DECISIONS = Path(__file__).parents[3] / "docs" / "decisions.md"


def declared(model: type[Model]) -> Mapping[str, Option[Any]]:
    return options_of(firmware(model))


FIRMWARES = {firmware(model): key for key, model in reversed(list(MODELS.items()))}
"""Each firmware, with the first model that has it."""
FIRST = sorted(FIRMWARES.values(), key=list(MODELS).index)
EVERY = [(key, name) for key in FIRST for name in declared(MODELS[key])]


def values_of(option: Option[Any]) -> list[str]:
    """Give values of an option that differ, as they are typed."""
    match option.kind:
        case OnOff():
            return ["on", "off"]
        case OneOf(choices):
            return list(choices)
        case Times():
            return ["off", "300ms"]
        case Limit():
            return ["300ms", "never"]
    raise AssertionError(option)


# How they are said


def test_in_the_word_for_servos() -> None:
    groups = parse_specs("rx28@1-2,goal_torque=off,4,lx16a@7,surplus=ignored,wait_read=silent,rx28@9")
    assert groups == [
        Group(RX28, [1, 2, 4], {"goal_torque": "off"}),
        Group(LX16A, [7], {"surplus": "ignored", "wait_read": "silent"}),
        Group(RX28, [9]),
    ]
    servos = build_rig(Setup(groups)).servos
    assert [servo.options.get("goal_torque") for servo in servos] == [False, False, False, True, True]
    assert servos[4].options["surplus"] == "ignored"  # each family has a line of its own


def test_in_the_name_of_a_port_for_all_that_have_it() -> None:
    servos = connect("virtual:rx28@1,lx16a@2,goal_torque=on,drs0602@3?goal_torque=off&boot_time=0.6s").servos
    assert [servo.options.get("goal_torque") for servo in servos] == [False, True, None]
    assert {servo.options["boot_time"] for servo in servos} == {Span(0.6, 0.6)}


@pytest.mark.parametrize("reading", READINGS)
@every_model
def test_a_whole_reading(key: str, reading: Any) -> None:
    model = MODELS[key]
    (servo,) = connect(f"virtual:{key}@1?as={reading}").servos
    assert servo.options == defaults(firmware(model), model, reading)
    assert servo.options == virtual_servo(model, 1, reading=reading).options
    usual = defaults(firmware(model), model)
    assert (servo.options == usual) == (reading == "practice" or defaults(firmware(model), model, "manual") == usual)


def test_an_option_beside_a_reading() -> None:
    (servo,) = connect("virtual:rx28@1,goal_torque=on?as=manual").servos
    assert (servo.options["goal_torque"], servo.options["answer_time"]) == (True, (0, 0))


def test_from_python() -> None:
    servo = virtual_servo(RX28, 1, options={"goal_torque": False, "answer_time": (0, 1e-3), "boot_time": 0.6})
    assert servo.options["answer_time"] == Span(0, 1e-3)
    kind: Any = type(servo)
    assert kind.goal_torque.practice is True
    anything: Any = servo
    assert anything.goal_torque is False
    anything.goal_torque = "on"
    assert servo.options["goal_torque"] is True
    with pytest.raises(BadValue, match=r"goal_torque=maybe.*on, off"):
        anything.goal_torque = "maybe"


@pytest.mark.parametrize(
    ("spec", "kind", "why"),
    [
        (
            "rx28@1,gaol_torque=off",
            UsageError,
            "RX-28 has no option 'gaol_torque'.*mean goal_torque.*boot_time",
        ),
        ("rx28@1?surplus=obeyed", UsageError, "RX-28 has no option 'surplus'"),
        (
            "rx28@1,lx16a@2?gaol_torque=off",
            UsageError,
            "no servo here.*RX-28: did you mean.*LX-16A: did you",
        ),
        ("rx28@1?gaol_torque=off", UsageError, "clock, echo"),
        ("lx16a@1,surplus=eaten", BadValue, "LX-16A: surplus=eaten.*obeyed, ignored"),
        ("rx28@1?broadcast_ping=", BadValue, "silent, answered"),
        ("rx28@1,eeprom_pause=7ms-5ms", BadValue, "eeprom_pause=7ms-5ms"),
        ("rx28@1,eeprom_pause=-1ms", BadValue, "eeprom_pause"),
        ("rx28@1,answer_time=nan", BadValue, "answer_time"),
        ("rx28@1,answer_time=5", BadValue, "answer_time=5: 5 has no unit; write 5ms or 5s"),
        ("rx28@1?answer_time=5-7ms", BadValue, "write 5ms or 5s"),
        ("rx28@1,overload_time=1.5", BadValue, "write 1.5ms or 1.5s"),
        ("rx28@1,boot_time=1h", BadValue, "boot_time"),
        ("rx28@1,overload_time=0", BadValue, "overload_time"),
        ("rx28@1?as=hearsay", BadValue, "practice, manual"),
        ("goal_torque=off,rx28@1", UsageError, "MODEL@IDS"),
        ("rx28@1,ccw_angle_limit=0x10000", BadValue, "ccw_angle_limit: 65536"),
        ("rx28@1,ccw_angle_limit=far", BadValue, "ccw_angle_limit=far"),
        ("rx28@1,goal_position=5", BadValue, "goal_position is lost at power-off"),
        ("rx28@1,id=254", BadValue, "254"),
    ],
)
def test_what_makes_no_sense(spec: str, kind: type[Exception], why: str) -> None:
    with pytest.raises(kind, match=why):
        connect(f"virtual:{spec}")


@pytest.mark.parametrize(
    ("word", "span"),
    [
        ("6ms", Span(0.006, 0.006)),
        ("5ms-7ms", Span(0.005, 0.007)),
        ("off", Span(0, 0)),
        ("on", Span(0.005, 0.007)),
        ("20us-0.2ms", Span(20e-6, 200e-6)),
        ("0.6s", Span(0.6, 0.6)),
        ("0", Span(0, 0)),
    ],
)
def test_times(word: str, span: Span) -> None:
    read = Times(usual=Span(0.005, 0.007)).read(word)
    assert read == pytest.approx(span)
    assert Times().read(Times().show(read)) == pytest.approx(span)


def test_what_registers_hold() -> None:
    servos = connect("virtual:rx28@1,ccw_angle_limit=0xFFFF,min_voltage=7V,lx16a@2?max_voltage=14.0V").servos
    assert servos[0].get("ccw_angle_limit") == 0xFFFF
    assert servos[0].get("lowest_limit_voltage") == 70
    assert servos[1].get("max_voltage") == 14_000
    assert servos[0].get("max_voltage") == 140


def test_what_they_hold_survives_in_a_state_file(tmp_path: Path) -> None:
    url = f"virtual:lx16a@1{{}}?state={tmp_path / 'k.json'}"
    connect(url.format(",max_voltage=14V"))
    assert connect(url.format("")).servos[0].get("max_voltage") == 14_000


def test_a_model_can_have_its_own() -> None:
    class AX(RX28):
        title, number = "AX-99", 12
        practice = {"eeprom_pause": "on", "broadcast_ping": "answered"}  # noqa: RUF012

    class AXW(AX):
        title, number = "AX-99W", 300
        practice = {"broadcast_ping": "silent"}  # noqa: RUF012

    assert virtual_servo(AX, 1).options["eeprom_pause"] == Span(0.005, 0.007)
    assert virtual_servo(AX, 1).options["broadcast_ping"] == "answered"
    assert virtual_servo(AXW, 1).options["eeprom_pause"] == Span(0.005, 0.007)
    assert virtual_servo(AXW, 1).options["broadcast_ping"] == "silent"
    assert virtual_servo(AX, 1, reading="manual").options["broadcast_ping"] == "silent"
    AX.practice = {"nothing": "on"}
    with pytest.raises(UsageError, match="AX-99 has no option 'nothing'"):
        virtual_servo(AX, 1)


def test_options_and_registers_have_different_names() -> None:
    for model in MODELS.values():
        assert not set(declared(model)) & {*model.registers, *model.aliases}


# What the page of decisions says


def entries() -> dict[str, str]:
    text = DECISIONS.read_text(encoding="utf-8")
    found = re.findall(r"^- \*\*(E[HDL]-\d\d)\*\* (.*(?:\n  .*)*)", text, re.MULTILINE)
    return {number: " ".join(said.split()) for number, said in found}


@pytest.mark.parametrize(("key", "name"), EVERY)
def test_every_option_has_an_entry_that_names_it_and_its_values(key: str, name: str) -> None:
    option = declared(MODELS[key])[name]
    said = entries()[option.decision]
    about = said[said.index(f"`{name}`") :]
    practice, manual = option.kind.show(option.practice), option.kind.show(option.manual)
    assert ("in both readings" in about) == (practice == manual), said
    if isinstance(option.kind, OneOf | OnOff):
        assert practice in about.lower()
        assert manual in about.lower()
    assert re.search(r"\*(recorded|reported|unproven|reports?)\b", said, re.IGNORECASE), said


def test_every_option_in_an_entry_is_declared() -> None:
    known = {(option.decision, name) for model in MODELS.values() for name, option in declared(model).items()}
    said = {(number, name) for number, text in entries().items() for name in re.findall(r"Option `(\w+)`", text)}
    assert said == known


# What each does


def hx(text: str) -> bytes:
    id, code, *data = bytes.fromhex(text)
    check = 0
    for byte in (size := len(data) + 7, id, code, *data):
        check ^= byte
    return bytes([0xFF, 0xFF, size, id, code, check & 0xFE, ~check & 0xFE, *data])


FRAMED: dict[str, Callable[[str], bytes]] = {"dynamixel": dxl, "herkulex": hx, "lewansoul": lx}
PING = {"dynamixel": "01 02 01", "herkulex": "01 07", "lewansoul": "01 03 0E"}
STORE = {"dynamixel": "01 04 03 11 24", "herkulex": "01 01 06 01 1E", "lewansoul": "01 04 18 50"}
"""Writes of one byte to the EEPROM that change nothing before the next start."""

Look = Callable[[Wire, Callable[..., str]], Any]


def steps(*packets: "str | float") -> Look:
    """Say packets, let times pass; what is seen is the last answer."""

    def look(wire: Wire, say: Callable[..., str]) -> str:
        heard = ""
        for packet in packets:
            if isinstance(packet, float):
                wire.wait(packet)
            else:
                heard = say(packet)
        return heard

    return look


def after_a_turn_by_hand(on: str, off: str, move: str) -> Look:
    def look(wire: Wire, say: Callable[..., str]) -> float:
        say(on)
        say(move)
        wire.wait(2.0)
        say(off)
        wire.observe()
        wire.servo.turn_shaft(wire.servo.position - 40 * deg)
        wire.wait(0.1)
        say(on)
        wire.wait(2.0)
        return round(wire.servo.position / deg)

    return look


def blocked(*packets: "str | float") -> Look:
    def look(wire: Wire, say: Callable[..., str]) -> Any:
        wire.servo.shaft.load = Load(blocked=1.0)
        return steps(*packets)(wire, say)

    return look


def weak_supply(wire: Wire, say: Callable[..., str]) -> str:
    say("01 04 1F 01")
    wire.observe()
    wire.servo.voltage = 5.0
    wire.wait(0.5)
    wire.servo.voltage = 7.4
    wire.wait(0.5)
    return say("01 03 20")


def forgotten_mask(wire: Wire, say: Callable[..., str]) -> str:
    say("01 04 23 05")
    wire.power_cycle()
    return say("01 03 24")


def unframed(packet: str) -> Look:
    def look(wire: Wire, say: Callable[..., str]) -> str:
        return wire.say(packet).text

    return look


def first(wire: Wire, say: Callable[..., str]) -> float:
    family = wire.servo.model.family.name
    return wire.say(FRAMED[family](PING[family]), listen=1.0).first


def deaf_after(change: Callable[[Wire], None]) -> Look:
    def look(wire: Wire, say: Callable[..., str]) -> str:
        change(wire)
        return say(PING[wire.servo.model.family.name])

    return look


def store(wire: Wire) -> None:
    family = wire.servo.model.family.name
    wire.say(FRAMED[family](STORE[family]))


def plug(wire: Wire) -> None:
    wire.line.unplug(wire.line.servos, wire.now)
    wire.wait(0.1)
    wire.line.plug(wire.line.servos, wire.now)


def turned_speed(value: str) -> Look:
    """Tell whether infinite turn with this value is fast at once, although the playtime is 254: 2.8 s."""

    def look(wire: Wire, say: Callable[..., str]) -> bool:
        say("01 03 34 01 60")  # torque on
        say(f"01 05 {value} 02 01 FE")
        wire.wait(0.1)
        before = wire.servo.position
        wire.wait(0.1)
        return abs(wire.servo.position - before) / 0.1 > 130 * deg

    return look


def herkulex_effects(goal: str, far: str, shift: str, edge: str, turn: str) -> dict[str, Look]:
    """Give the effects on a HerkuleX.

    goal, far  positions 57° and 113° from the middle
    shift      a write of Calibration Difference
    edge       a goal within the limits, which is outside with that difference
    turn       a value of infinite turn, 200°/s or more
    """
    return {
        "goal_after_limp": after_a_turn_by_hand("01 03 34 01 60", "01 03 34 01 00", f"01 05 {goal} 00 01 3C"),
        "position_flags": steps("01 04 3A 02"),
        "brake_jog": steps("01 03 34 01 40", f"01 05 {goal} 00 01 3C", 1.0, "01 04 34 01"),
        "overload_step": blocked("01 03 34 01 60", f"01 05 {far} 00 01 00", 1.2, "01 07"),
        "goal_limits": steps(f"01 03 {shift}", "01 03 34 01 60", f"01 05 {edge} 00 01 3C", "01 04 30 01"),
        "turn_playtime": turned_speed(turn),
    }


EFFECTS: dict[str, dict[str, Look]] = {
    "rx28": {
        "goal_torque": steps("01 05 03 1E BC 02", "01 04 02 18 01"),
        "broadcast_ping": steps("FE 02 01"),
        "goal_after_limp": after_a_turn_by_hand("01 04 03 18 01", "01 04 03 18 00", "01 05 03 1E BC 02"),
        # a goal, endless turn, full output, the limits back
        "goal_after_turn": steps(
            "01 05 03 1E BC 02", 2.0, "01 07 03 06 00 00 00 00", "01 05 03 20 FF 03", 0.3, "01 05 03 20 00 00",
            "01 07 03 06 00 00 FF 03", "01 04 02 1E 02",
        ),
        "turn_goal": steps("01 07 03 06 00 00 00 00", "01 05 03 1E BC 02"),
        "goal_outside": steps("01 07 03 06 90 01 58 02", "01 05 03 1E BC 02", "01 04 02 1E 02"),
        "bad_checksum": unframed("FF FF 01 04 02 18 01 00"),  # DF would be right
        # both slopes 100, a goal 40 units away
        "slope_levels": blocked("01 07 03 1A 00 00 64 64", "01 05 03 1E 28 02", 0.1, "01 04 02 28 02"),
        # 50 units of margin on the clockwise side of the goal, and a goal 30 units away
        "compliance_sides": blocked("01 05 03 1A 32 00", "01 05 03 1E 1E 02", 0.1, "01 04 02 28 02"),
        "overload_time": blocked("01 05 03 1E FF 03", 1.0, "01 04 02 22 02"),
    },
    "mx28": {
        "broadcast_ping": steps("FE 02 01"),
        "goal_after_limp": after_a_turn_by_hand("01 04 03 18 01", "01 04 03 18 00", "01 05 03 1E BC 02"),
        # a goal, wheel mode, 300 units of speed, the limits back
        "goal_after_turn": steps(
            "01 05 03 1E BC 02", 2.0, "01 07 03 06 00 00 00 00", "01 05 03 20 2C 01", 0.3, "01 05 03 20 00 00",
            "01 07 03 06 00 00 FF 0F", "01 04 02 1E 02",
        ),
        "turn_goal": steps("01 07 03 06 00 00 00 00", "01 05 03 1E BC 02"),
        "goal_outside": steps("01 07 03 06 90 01 58 02", "01 05 03 1E BC 02", "01 04 02 1E 02"),
        "bad_checksum": unframed("FF FF 01 04 02 18 01 00"),  # DF would be right
        "overload_time": blocked("01 04 03 18 01", "01 05 03 1E FF 0F", 1.0, "01 04 02 22 02"),
    },
    # 18432 and 20480; 1000, and 22000 of 22129; 320 units of 0.62°/s
    "drs0602": herkulex_effects("00 48", "00 50", "2E 02 E8 03", "F0 55", "40 01"),
    # 687 and 860; 100, and 992 of 1002; 700 of 1023
    "drs0101": herkulex_effects("AF 02", "5C 03", "2F 01 64", "E0 03", "BC 02"),
    # 1373 and 1717; 100, and 1990 of 2004; 320 units of 0.62°/s
    "drs0401": herkulex_effects("5D 05", "B5 06", "2E 02 64 00", "C6 07", "40 01"),
    "lx16a": {
        "goal_torque": steps("01 07 01 C8 00 00 00", "01 03 20"),
        "goal_after_limp": after_a_turn_by_hand("01 04 1F 01", "01 04 1F 00", "01 07 01 BC 02 00 00"),
        "surplus": steps("01 05 1F 01 00", "01 03 20"),
        "out_of_range": steps("01 04 18 C8", "01 03 19"),
        "wait_read": steps("01 03 08"),
        "voltage_recovery": weak_supply,
        "mask_saved": forgotten_mask,
    },
}  # fmt: skip
EVERYWHERE: dict[str, Look] = {
    "answer_time": first,
    "eeprom_pause": deaf_after(store),
    "boot_time": deaf_after(plug),
}


@pytest.mark.parametrize(("key", "name"), EVERY)
def test_every_value_of_every_option_has_an_effect(key: str, name: str) -> None:
    look, framed = (EFFECTS[key] | EVERYWHERE)[name], FRAMED[MODELS[key].family.name]
    seen = {}
    for word in values_of(declared(MODELS[key])[name]):
        wire = Wire(virtual_servo(MODELS[key], 1, reading="practice", options={name: word}))
        seen[word] = look(wire, lambda packet, wire=wire: wire.say(framed(packet)).text)
    assert len(set(seen.values())) == len(seen), seen


# The driver


def variants() -> list[str]:
    """Give the word behind a port's name for each reading, and for each option that is otherwise."""
    made = [f"{key}@1?as={reading}" for key in FIRST for reading in READINGS]
    for key, name in EVERY:
        option = declared(MODELS[key])[name]
        usual = option.kind.show(defaults(firmware(MODELS[key]), MODELS[key])[name])
        others = {"eeprom_pause": ["on"], "boot_time": ["2s"], "answer_time": ["off"]}.get(name, values_of(option))
        made += [f"{key}@1,{name}={word}?as=practice" for word in others if word != usual]
    return made


@pytest.mark.parametrize("spec", variants())
def test_the_driver_gets_along_with_each(spec: str, tmp_path: Path) -> None:
    port = connect(f"virtual:{spec}&clock=virtual")
    bus = Bus(port)
    (servo,) = bus.scan(ids=[1], family=port.servos[0].model.family.name)
    real = port.servos[0]
    here = real.position
    assert not moved(port, real, here)
    servo.torque_on()
    assert not moved(port, real, here)
    start, goal = servo.read(servo.model.register("present_position")), 60 * deg
    servo.move(goal, speed=90 * deg).wait()
    port.sleep(0.3)
    assert abs(servo.read(servo.model.register("present_position")) - goal) < 2 * deg, start
    servo.move(goal + 60 * deg, speed=60 * deg)
    port.sleep(0.3)
    servo.stop()
    port.sleep(0.3)
    here = port.servos[0].position
    assert not moved(port, real, here)
    servo.torque_off()
    servo.torque_on()
    assert not moved(port, real, here)
    servo.turn(**turning(servo.model))
    port.sleep(0.2)
    servo.stop()
    port.sleep(1.0)
    here = port.servos[0].position
    servo.position_mode(limits=(goal_low(servo.model), goal_high(servo.model)) if servo.model is RX28 else None)
    assert not moved(port, real, here)
    servo.torque_off()
    saved = servo.backup()
    servo.restore(saved)
    assert not moved(port, real, port.servos[0].position)
    assert not port.servos[0].torque


def goal_low(model: type[Model]) -> float:
    row = model.register("goal_position")
    return float(row.decode(row.limits[0]))


def goal_high(model: type[Model]) -> float:
    row = model.register("goal_position")
    return float(row.decode(row.limits[1]))


def moved(port: VirtualPort, real: VirtualServo, here: float) -> bool:
    """Let a second pass, and tell whether the shaft went more than a degree."""
    port.sleep(1.0)
    port.servos  # noqa: B018 - brings them up to date
    return abs(real.position - here) > 1 * deg


@pytest.mark.parametrize(
    "text",
    [
        "virtual:rx28@1,goal_torque=off,goal_torque=on",
        "virtual:rx28@1?baud=115200&baud=57600",
        "virtual:rx28@1?goal_torque=off&goal_torque=on",
        "virtual:rx28@1?as=manual&as=practice",
    ],
)
def test_P1_what_is_said_twice_is_refused(text: str) -> None:
    with pytest.raises(UsageError, match=r"says \w+ twice"):
        parse_url(text)


def test_P1_a_speed_that_is_no_number_is_named() -> None:
    with pytest.raises(UsageError, match="'abc' is no speed; write it as a number such as 115200"):
        parse_url("virtual:rx28@1?baud=abc")
