"""What a request does to the servos that it is for, as its bytes tell it.

Who shares a bus with others wants to know before a request goes out whether it only asks, or moves something, and
afterwards which value it wrote where. `Family.effect` tells it of a packet. Where bytes leave a doubt, they are taken
to drive: a servo that was not set in motion is stopped for nothing, but one in motion is never taken for one at rest.
"""

import enum
from collections.abc import Mapping
from types import MappingProxyType
from typing import Any

from servobus.core.registers import Register
from servobus.core.values import frozen


class Kind(enum.Flag):
    """What is done to a servo; a request can do several of these at once."""

    READS = enum.auto()
    """It is asked, and changes nothing."""
    WRITES = enum.auto()
    """A value is set that is lost at power-off. How hard and how closely it holds its goal, such as a gain, is one: it
    sets nothing in motion that is at rest."""
    STORES = enum.auto()
    """Something is changed for good, or the servo is another one to the bus from then on: EEPROM, id, speed, a factory
    reset, a restart."""
    DRIVES = enum.auto()
    """It may be set in motion, now or by a later start of what it keeps, or its torque may come on."""
    STOPS = enum.auto()
    """Its motion ends, and what held it holds it."""
    RELEASES = enum.auto()
    """Its motor drives it no more: torque off, or brake."""


NO_KIND = Kind(0)
NOTHING: Mapping[Register[Any], int] = MappingProxyType({})


@frozen
class Touch:
    """What a request does to one servo.

    id       the servo, or the broadcast id for all
    kinds    all that is done to it
    written  raw values that it is given, as far as the model's table tells them
    """

    id: int
    kinds: Kind
    written: Mapping[Register[Any], int] = NOTHING


@frozen
class Effect:
    """What a request does, servo by servo, in the order of the packet. Empty if it leaves all of them alone."""

    touches: tuple[Touch, ...]

    @property
    def kinds(self) -> Kind:
        """All that is done to any of them."""
        kinds = NO_KIND
        for touch in self.touches:
            kinds |= touch.kinds
        return kinds

    @property
    def ids(self) -> tuple[int, ...]:
        """The servos that are touched, each once; the broadcast id stands for all."""
        return tuple(dict.fromkeys(touch.id for touch in self.touches))

    @property
    def only_reads(self) -> bool:
        """Whether nothing is changed in any servo."""
        return not self.kinds & ~Kind.READS

    def ids_of(self, kinds: Kind) -> tuple[int, ...]:
        """Give the servos to which one of these things is done, each once."""
        return tuple(dict.fromkeys(touch.id for touch in self.touches if touch.kinds & kinds))
