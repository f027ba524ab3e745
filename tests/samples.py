"""What tests know of servos without asking the code under test, and the parametrisations over models.

A `Sample` holds what the manuals say of a family's bytes and habits; one for each family, in SAMPLES. What differs
between the models of a family is told by the table of the model, with the functions below it: a new model of a known
family needs no line here. What belongs to one model alone, such as printed figures and golden packets, stands in the
files that are named after it.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable
from functools import reduce
from operator import xor
from typing import Any, ClassVar

import pytest

import extent
from servobus import MODELS
from servobus.core.framing import Packet
from servobus.core.registers import Access, Register
from servobus.core.units import Quantity, deg
from servobus.families.base import Answers, Family, Model
from servobus.families.herkulex.places import EepRam

CODE = 4
"""Place of the instruction or command in a packet; the same in the three families."""


class Sample(ABC):
    """What a family's manual says. `Place` is the number of a byte in a packet, from 0 on; bits count from 0 too."""

    header: ClassVar[bytes]
    id_at: ClassVar[int]
    """Place of the id."""
    answer_size: ClassVar[int]
    """Bytes of the answer with a position."""
    value_at: ClassVar[int]
    """Place of the position in that answer, low byte first."""
    unseen: ClassVar[dict[int, int]] = {}
    """Bits of that answer that no rule of the protocol protects -> what a flipped one changes in the position."""
    by_chance: ClassVar[int] = 0
    """How many of the answers with junk in them may fit by chance (F4)."""
    longest: ClassVar[int]
    """Bytes of the longest packet that moves several servos."""
    crowd: ClassVar[int]
    """More servos than one such packet holds."""
    speeds: ClassVar[tuple[int, ...]]
    """Some speeds that every model can be set to, bit/s; none if it has one only."""
    asking: ClassVar[frozenset[int]]
    """Instructions that ask and change nothing."""
    on: ClassVar[int] = 1
    """Raw value of torque_enable with the torque on."""
    hot: ClassVar[int]
    """Alarm for heat, among the family's flags."""
    hot_word: ClassVar[str]
    flat: ClassVar[int]
    """Alarm for a supply below the limits."""
    minds_overload: ClassVar[bool] = True
    """Whether a servo that is blocked switches its torque off."""
    recovers: ClassVar[bool] = False
    """Whether the torque comes back by itself when an alarm is over."""
    resets: ClassVar[bool] = True
    """Whether there is a command that restores the settings from the factory."""
    acknowledges_level: ClassVar[bool] = True
    """Whether a write of the answer level itself is known to be answered, so that a lost answer shows."""
    beyond: ClassVar[int] = 0
    """Position units that the sensor tells beyond what can be a goal, on either side."""
    stops_of_torque_on: ClassVar[int] = 0
    """Commands among those that switch the torque on which `stops` counts."""
    pairs: ClassVar[tuple[int, int, int]]
    """A position; the pairs of bits in the answer with it; and those of them that are unseen, counted for it."""

    @abstractmethod
    def fits(self, frame: bytes) -> bool:
        """Tell whether the checksum of a frame is right."""

    @abstractmethod
    def position_answer(self, id: int, raw: int) -> bytes:
        """Build the answer of a servo at this position."""

    def without_state(self, answer: bytes) -> bytes:
        """Give an answer as `position_answer` builds it, where it tells the state of the servo too."""
        return answer

    @abstractmethod
    def cancel(self, answer: bytes, one: int, other: int) -> bool:
        """Tell whether two flipped bits of the answer with a position stay unseen, by the rules of the checksum."""

    @abstractmethod
    def stops(self, packet: Packet) -> bool:
        """Tell whether a command ends the motion of a servo and leaves its torque on."""

    @abstractmethod
    def frees(self, packet: Packet) -> bool:
        """Tell whether a command switches the torque off."""

    @abstractmethod
    def writes_eeprom(self, request: bytes) -> bool:
        """Tell whether a request writes to the EEPROM."""

    @abstractmethod
    def writes_id(self, request: bytes) -> bool:
        """Tell whether a request gives a servo the id that it listens to at once."""

    def changes_speed(self, request: bytes) -> bool:
        """Tell whether a request makes a servo go to another speed."""
        raise NotImplementedError

    def writes(self, request: bytes) -> bool:
        """Tell whether a request sets anything."""
        return request[CODE] not in self.asking

    def positions(self, id: int, heard: bytes) -> list[int]:
        """Give the positions in whatever is a good answer of this servo among these bytes."""
        pattern = self.position_answer(id, 0)
        known = [at for at in range(self.value_at) if at not in self._check_places()]
        size = self.answer_size
        frames = (heard[n : n + size] for n in range(len(heard) - size + 1))
        good = (frame for frame in frames if all(frame[at] == pattern[at] for at in known) and self.fits(frame))
        return [self._position(frame[self.value_at : self.value_at + 2]) for frame in good]

    def _check_places(self) -> tuple[int, ...]:
        """Give the places of the checksum, where it stands before the position, and of what may be anything."""
        return ()

    def _position(self, value: bytes) -> int:
        return int.from_bytes(value, "little")


class _Sum(Sample):
    """A checksum that is the sum of all bytes behind the header, inverted, at the end."""

    known: ClassVar[int]
    """Bytes at the beginning of an answer that are known beforehand."""

    def fits(self, frame: bytes) -> bool:
        return ~sum(frame[2:-1]) & 0xFF == frame[-1]

    def _framed(self, body: bytes) -> bytes:
        return self.header + body + bytes([~sum(body) & 0xFF])

    def cancel(self, answer: bytes, one: int, other: int) -> bool:
        """Both in one column, one up and the other down; in the highest column anyhow, as two of them carry out."""
        if one % 8 != other % 8 or one // 8 < self.known or other // 8 < self.known:
            return False
        up = [answer[bit // 8] >> bit % 8 & 1 for bit in (one, other)]
        return up[0] != up[1] or one % 8 == 7


class DynamixelSample(_Sum):
    """Dynamixel protocol 1.0; numbers of sections are those of the RX-28 manual."""

    header = b"\xff\xff"
    id_at = 2
    answer_size, value_at, known = 8, 5, 4  # 3-3, 3-5-1
    longest, crowd = 143, 40  # 3-5-7
    speeds = (1_000_000, 500_000, 115_200, 57_600)  # 3-4-1 address 4
    asking = frozenset({0x01, 0x02})  # PING, READ_DATA (3-2)
    hot, hot_word, flat = 0x04, "overheating", 0x01  # 3-3
    stops_of_torque_on = 1  # the present position is made the goal first
    pairs = (0x0155, 2016, 23)

    def position_answer(self, id: int, raw: int) -> bytes:
        return self._framed(bytes([id, 4, 0, raw & 0xFF, raw >> 8]))

    def _check_places(self) -> tuple[int, ...]:
        return (4,)  # the error bits

    def stops(self, packet: Packet) -> bool:
        """WRITE_DATA to Goal Position alone: 30, two bytes (3-4)."""
        return packet.code == 3 and packet.data[0] == 30 and len(packet.data) == 3

    def frees(self, packet: Packet) -> bool:
        """WRITE_DATA to Torque Enable: 24 (3-4)."""
        return packet.code == 3 and packet.data == bytes([24, 0])

    def writes_eeprom(self, request: bytes) -> bool:
        """WRITE_DATA to the addresses 0 to 23 (3-4)."""
        return request[CODE] == 3 and request[5] < 24

    def writes_id(self, request: bytes) -> bool:
        """WRITE_DATA to address 3."""
        return request[CODE : CODE + 2] == b"\x03\x03"

    def changes_speed(self, request: bytes) -> bool:
        """WRITE_DATA to address 4."""
        return request[CODE : CODE + 2] == b"\x03\x04"


class HerkulexSample(Sample):
    """HerkuleX; numbers of sections are those of the DRS-0602 manual."""

    header = b"\xff\xff"
    id_at = 3
    answer_size, value_at = 13, 9  # 6-4
    unseen = {72: 0x0001, 80: 0x0100, 88: 0, 96: 0}  # noqa: RUF012 - bit 0 is not in the checksum (5-2): value and status
    by_chance = 2
    longest, crowd = 223, 60  # 5-1
    speeds = (500_000, 57_600, 115_200)  # 4-2 NO 5
    asking = frozenset({0x02, 0x04, 0x07})  # EEP_READ, RAM_READ, STAT (5-1)
    on = 0x60  # 4-2 NO 47
    stops_of_torque_on = 3  # in case the servo kept its goal
    acknowledges_level = False  # by the old policy or by the new one is an assumption (H-30)
    hot, hot_word, flat = 0x04, "temperature", 0x01  # 4-2 NO 43
    pairs = (0x4155, 5356, 48)

    def fits(self, frame: bytes) -> bool:
        check = reduce(xor, frame[2:5] + frame[7:], 0)
        return frame[5] == check & 0xFE and frame[6] == ~check & 0xFE

    def _position(self, value: bytes) -> int:
        """Leave out the flag above the 15 bits that the maker's PC tool takes as the position."""
        return super()._position(value) & 0x7FFF

    def position_answer(self, id: int, raw: int) -> bytes:
        """RAM_READ of two bytes at 58 (6-4), status 0 and 1."""
        body, value = bytes([13, id, 0x44]), bytes([58, 2, raw & 0xFF, raw >> 8, 0, 1])
        check = reduce(xor, body + value)
        return self.header + body + bytes([check & 0xFE, ~check & 0xFE]) + value

    def without_state(self, answer: bytes) -> bytes:
        return answer[:-2] + bytes([0, 1])

    def _check_places(self) -> tuple[int, ...]:
        return 5, 6

    def cancel(self, answer: bytes, one: int, other: int) -> bool:  # noqa: ARG002 - an exclusive or knows no carry
        """Both in one column, but not in a check byte; in column 0 each alone is unseen."""
        seen = [bit for bit in (one, other) if bit not in self.unseen]
        body = all(bit // 8 >= self.value_at for bit in (one, other))  # what stands before is known beforehand
        return not seen or (body and one % 8 == other % 8)

    def stops(self, packet: Packet) -> bool:
        """I_JOG, SET with the stop flag (6-5)."""
        return packet.code == 5 and bool(packet.data[2] & 1)

    def frees(self, packet: Packet) -> bool:
        """RAM_WRITE of Torque Control."""
        return packet.code == 3 and packet.data == bytes([52, 1, 0])

    def writes_eeprom(self, request: bytes) -> bool:
        """EEP_WRITE (5-1)."""
        return request[CODE] == 1

    def writes_id(self, request: bytes) -> bool:
        """RAM_WRITE to address 0."""
        return request[CODE] == 3 and request[7] == 0

    def changes_speed(self, request: bytes) -> bool:
        """REBOOT, after which the speed in EEP counts (5-1)."""
        return request[CODE] == 9


class LewansoulSample(_Sum):
    """LewanSoul; numbers of points are those of the protocol document's section 4."""

    header = b"\x55\x55"
    id_at = 2
    answer_size, value_at, known = 8, 5, 5  # point 17; the command is in it
    longest, crowd = 10, 20  # one servo a packet
    speeds = ()  # 115200 alone
    asking = frozenset({2, 8, 14, 19, 21, 23, 25, 26, 27, 28, 30, 32, 34, 36})
    hot, hot_word, flat = 0x01, "over_temperature", 0x02  # point 27; the voltage on either side of its limits (EL-11)
    minds_overload = False
    recovers = True  # L-54
    resets = False
    beyond = 125  # point 20: -30° and 270° of 0 to 240°
    pairs = (0x0155, 2016, 11)

    def position_answer(self, id: int, raw: int) -> bytes:
        return self._framed(bytes([id, 5, 28, raw & 0xFF, raw >> 8 & 0xFF]))

    def _position(self, value: bytes) -> int:
        return int.from_bytes(value, "little", signed=True)

    def stops(self, packet: Packet) -> bool:
        """SERVO_MOVE_STOP."""
        return packet.code == 12

    def frees(self, packet: Packet) -> bool:
        """SERVO_LOAD_OR_UNLOAD_WRITE."""
        return packet.code == 31 and packet.data == b"\0"

    def writes_eeprom(self, request: bytes) -> bool:
        """Id, saved offset, limits of angle, voltage and temperature, light."""
        return request[CODE] in (13, 18, 20, 22, 24, 33, 35)

    def writes_id(self, request: bytes) -> bool:
        """SERVO_ID_WRITE."""
        return request[CODE] == 13


SAMPLES: dict[str, Sample] = {
    "dynamixel": DynamixelSample(),
    "herkulex": HerkulexSample(),
    "lewansoul": LewansoulSample(),
}
"""Family -> its sample."""


def sample_of(key: str) -> Sample:
    """Give the sample of a model's family."""
    return SAMPLES[MODELS[key].family.name]


# What a model can, by its own table


def has(model: type[Model], name: str) -> bool:
    """Tell whether a model has a register of this name, be it its own or one that the families share."""
    return name in model.registers or name in model.aliases


def factory_baud(model: type[Model]) -> int:
    """Give the speed at which a model leaves the factory."""
    return model.factory_baud


def factory_bauds(family: Family) -> tuple[int, ...]:
    """Give the speeds at which the models of a family leave the factory, each once."""
    return tuple(dict.fromkeys(factory_baud(model) for model in MODELS.values() if model.family is family))


def other_bauds(model: type[Model]) -> list[int]:
    """Give some speeds that a model can be set to, without its factory speed."""
    return [baud for baud in SAMPLES[model.family.name].speeds if baud != factory_baud(model)]


def unusual_baud(family: Family) -> int:
    """Give a speed at which no model of a family leaves the factory."""
    return next(baud for baud in SAMPLES[family.name].speeds if baud not in factory_bauds(family))


def answer_levels(model: type[Model]) -> tuple[Answers, ...]:
    """Give what a model can be told to answer, from the least to the most."""
    return tuple(Answers) if has(model, "answer_level") else (Answers.READS,)


def factory_answers(model: type[Model]) -> Answers:
    """Give what a model answers when it comes from the factory."""
    return Answers(model.register("answer_level").default or 0) if has(model, "answer_level") else Answers.READS


def hottest(model: type[Model]) -> float:
    """Give the temperature limit from the factory, °C."""
    row = model.register("max_temperature")
    assert row.default is not None
    limit: float = row.decode(row.default)
    return limit


def output_limit(model: type[Model]) -> Register[Any] | None:
    """Give the register in RAM that bounds the output of a model; None if it has none."""
    return model.register("output_limit") if has(model, "output_limit") else None


def turning(model: type[Model], value: float | None = None) -> dict[str, float]:
    """Give what `turn` takes for endless turn: a speed in rad/s where the model controls it, else a share of output."""
    if model.turns_at_speed():
        return {"speed": 90 * deg if value is None else value}
    return {"output": 0.5 if value is None else value}


def goal_range(model: type[Model]) -> tuple[int, int]:
    """Give the lowest and the highest raw goal that a model takes as it comes from the factory."""
    low, high = model.register("min_position").default, model.register("max_position").default
    assert low is not None
    assert high is not None
    return low, high


def widest_range(model: type[Model]) -> tuple[int, int]:
    """Give the lowest and the highest raw goal that a model can be set to take."""
    return model.register("min_position").limits[0], model.register("max_position").limits[1]


def zero(model: type[Model]) -> int:
    """Give the raw position of the angle 0."""
    scale = model.register("present_position").scale
    assert isinstance(scale, Quantity)
    return scale.zero


def seams(model: type[Model]) -> list[int]:
    """Give raw positions at the ends of the goals, at a zero between them, and beyond where the sensor tells those."""
    low, high = goal_range(model)
    places = {low, low + 1, high - 1, high}
    if low < zero(model) < high:
        places |= {zero(model) - 1, zero(model)}
    if SAMPLES[model.family.name].beyond:
        places |= {low - 30, low - 1, high + 30}
    return sorted(places)


def ends(model: type[Model]) -> list[int]:
    """Give raw positions at and near the ends of all that the sensor tells, and at the ends of the goals."""
    (low, high), (first, last), beyond = goal_range(model), widest_range(model), SAMPLES[model.family.name].beyond
    places = {first, first + 1, low, (low + high + 1) // 2, high, last - 1, last}
    if low < zero(model) < high:
        places.add(zero(model))
    if beyond:
        places |= {first - beyond, first - 12, first - 1, last + 1, last + beyond}
    return sorted(places)


def slack(model: type[Model]) -> float:
    """Give how far from its goal a servo may come to rest, rad: a degree, and what its compliance or gain leaves free.

    A PID without integral leaves what friction holds, at most 4 % of the output: an MX gives 0.158 of the output a rad
    and unit of P gain (Rhoban BAM).
    """
    free = model.register("cw_compliance_margin").default if has(model, "cw_compliance_margin") else 0
    gain = model.register("p_gain").default if has(model, "p_gain") else None
    return 1 * deg + (free or 0) * model.sheet.resolution + (0.04 / (0.158 * gain) if gain else 0.0)


def keeps_twice(model: type[Model]) -> bool:
    """Tell whether settings are kept in EEPROM and act from a copy in RAM, which can be written alone."""
    return isinstance(model.register("max_temperature").place, EepRam)


def ram_setting(model: type[Model]) -> Register[Any] | None:
    """Give a register that acts from RAM, is written without moving anything, and is not changed by the servo itself.

    None where there is none.
    """
    return next((model.register(name) for name in ("punch", "position_kp") if has(model, name)), None)


def steady(model: type[Model]) -> str:
    """Name a register of the size of a position whose value stays what it is from the factory, and is not 0.

    Where a family reads registers by address, its answer looks like that with the position.
    """
    size = model.register("present_position").layout.size
    return next(
        row.name
        for row in model.registers.values()
        if row.layout.size == size and row.default and row.access is not Access.RESERVED
    )


def can_change_baud(model: type[Model]) -> bool:
    return has(model, "baud")


def can_be_silenced(model: type[Model]) -> bool:
    return has(model, "answer_level")


def limits_turn(model: type[Model]) -> bool:
    """Tell whether a model turns without end because both its angle limits are 0 (RX-28 manual 3-4-3)."""
    return model.family.name == "dynamixel" and model.turns


def may_be_equal(model: type[Model], pair: tuple[str, str]) -> tuple[int, ...]:
    """Give the raw values that both limits of a pair may have at once."""
    if not limits_turn(model) or pair != ("min_position", "max_position"):
        return ()
    return (0, 4095) if has(model, "multi_turn_offset") else (0,)  # ROBOTIS e-manual, MX-28, CW/CCW Angle Limit


def can_turn(model: type[Model]) -> bool:
    return model.turns


def can_reset(model: type[Model]) -> bool:
    return SAMPLES[model.family.name].resets


def minds_overload(model: type[Model]) -> bool:
    return SAMPLES[model.family.name].minds_overload


# Parametrisations


def kind(model: type[Model]) -> object:
    """Give what a model shares with those that it stands for: its family, and all that tests tell models apart by."""
    cans = (
        can_change_baud,
        can_be_silenced,
        can_reset,
        minds_overload,
        keeps_twice,
        output_limit,
        ram_setting,
        lambda model: model.turns_at_speed(),
    )
    return model.family.name, *(bool(can(model)) for can in cans)


def chosen(keys: Iterable[str]) -> list[str]:
    """Give all of these models with `--all`; else the first of each kind, which stands for the others."""
    if extent.everything:
        return list(keys)
    first: dict[object, str] = {}
    for key in keys:
        first.setdefault(kind(MODELS[key]), key)
    return list(first.values())


def keys_that(can: Callable[[type[Model]], bool]) -> list[str]:
    """Give the keys of the chosen models among those that can something."""
    return chosen(key for key, model in MODELS.items() if can(model))


def models_that(can: Callable[[type[Model]], bool]) -> pytest.MarkDecorator:
    """Run a test, as `key`, with the chosen models among those that can something."""
    return pytest.mark.parametrize("key", keys_that(can))


SAMPLE_KEYS = chosen(MODELS)
"""The keys of the chosen models."""
ONE_OF_EACH_FAMILY = list({model.family.name: key for key, model in reversed(list(MODELS.items()))}.values())[::-1]
"""The key of the first model of each family."""

SERIES_KEYS = (
    list({(model.family.name, model.series): key for key, model in reversed(list(MODELS.items()))}.values())[::-1]
    if extent.everything
    else ONE_OF_EACH_FAMILY
)
"""The key of the first model of each series with `--all`, else of each family."""

series_models = pytest.mark.parametrize("key", SERIES_KEYS)
"""For hundreds of cases of each model: the first model of each series with `--all`, else of each family."""
every_model = pytest.mark.parametrize("key", MODELS)
"""For what takes a few milliseconds: it is run with every model, always."""
sample_models = pytest.mark.parametrize("key", SAMPLE_KEYS)
"""For what takes longer: it is run with every model with `--all`, and else with the first of each kind."""
one_model_of_each_family = pytest.mark.parametrize("key", ONE_OF_EACH_FAMILY)
"""For what depends on the family's packets alone."""
