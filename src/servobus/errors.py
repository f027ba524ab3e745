"""Everything that can go wrong, as one tree.

    ServobusError
    ├── UsageError (ValueError)       what was asked makes no sense; nothing was sent
    │   ├── UnknownName (KeyError)    no such register, model, family or servo
    │   ├── BadValue                  a value that the register or the move cannot take
    │   ├── RobotFileError            a robot file that is wrong: with its line, the key, the value and the remedy
    │   ├── FormatError               a file of another program that cannot be taken over, or not be written
    │   └── EepromWear                a register in EEPROM was written too often lately
    ├── PortError (OSError)           the port cannot be opened, is in use, or is closed
    │   └── PortLost                  the port was open and went away: unplugged, hung up, or stuck
    ├── NotRestored                   a backup was restored but for some settings
    ├── BusError                      an exchange failed
    │   ├── NoReply (TimeoutError)    silence
    │   ├── Garbled                   bytes came, but no packet: wrong baud, noise, two servos at once
    │   │   ├── BadChecksum           a packet of the right shape that the checksum refuses
    │   │   └── ShortReply            the beginning of a packet
    │   ├── OtherProtocol             a packet of a protocol that is not understood here
    │   ├── WrongReply                a good packet that does not answer what was asked
    │   ├── DuplicateId               two answers to one question: two servos have one id
    │   ├── BrokenEcho                the line gave back something else than was sent
    │   ├── LineBusy                  bytes keep coming although nothing was asked
    │   ├── BadReading (ValueError)   a register reads as what it cannot hold, or as a code without meaning
    │   └── Refused                   the servo understood and said no
    ├── Held                          another program or person holds the servo: it can be read, not commanded
    ├── RobotMismatch                 the servos of a robot are not what its file says
    └── MotionError                   motion was refused, ended before its goal, or may go on
        ├── TorqueOff                 a move was asked of a servo without torque
        ├── OutsideLimits             torque would make it run to its limits, for it stands outside of them
        ├── Restarted                 the servo lost what was set in its RAM
        ├── Stopped                   the servos were made safe or stopped: what was under way ended
        ├── StopFailed                some of the servos that were to be stopped may still move
        ├── Disagreement              two servos on one axis do not stand at the same angle of their joint
        └── MoveTimeout (TimeoutError)  the servo did not arrive in time

A loop that asks again after a BusError never swallows a stop: neither Stopped nor StopFailed is a BusError.

An alarm (overheating, low voltage ...) is not in this tree: it is data, and stands beside the values.
"""

from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Any, Self


class ServobusError(Exception):
    """Base of all errors that servobus raises on purpose.

    before  what was there before the change that this error broke off, register -> value in its unit; empty where the
            error broke off no change of settings
    """

    before: Mapping[str, Any] = MappingProxyType({})

    def tell_before(self, before: Mapping[str, Any], said: str) -> None:
        """Say in the message what was there before, or what brings it back, and have it in `before`.

        What knows more of the change says it first, and that stays.
        """
        self.before = {**before, **self.before}
        if len(self.args) == 1:
            self.args = (f"{self.args[0]}; {said}",)
        else:
            self.add_note(said)

    def tell_whose(self, name: str) -> None:
        """Say in the message what the error came of, such as the name of a joint, unless it begins with that."""
        if not str(self).startswith(f"{name}: "):
            self.args = (f"{name}: {self}", *self.args[1:])

    def copy(self) -> Self:
        """Give the same error again, to be raised anew: one that is raised twice would have two tracebacks in one."""
        error = type(self).__new__(type(self))
        error.args = self.args
        error.__dict__.update(self.__dict__)
        return error


class UsageError(ServobusError, ValueError):
    """What was asked makes no sense. Nothing was sent."""


class UnknownName(UsageError, KeyError):
    """No register, model, family or servo has this name or number."""

    def __str__(self) -> str:
        # KeyError would print the repr of the message.
        return str(self.args[0]) if self.args else ""


class BadValue(UsageError):
    """A value that a register or a move cannot take."""


class RobotFileError(UsageError):
    """A robot file cannot be read or is wrong. The message says where, what, and how it is mended."""


class FormatError(UsageError):
    """A file of another program cannot be read as such, or does not say what a robot file needs; or the other way."""


class EepromWear(UsageError):
    """A register in EEPROM was written too often lately. It was read, and not written."""


class PortError(ServobusError, OSError):
    """The port cannot be opened, is in use, or is closed."""


class PortLost(PortError):
    """The port was open and went away: unplugged, hung up, or it takes no more bytes. `reopen` may find it again."""


class NotRestored(ServobusError):
    """A backup was restored but for some settings, each of which is named with the reason.

    restored  names of the settings that were written
    failed    setting -> why it could not be written
    """

    def __init__(self, message: str, restored: Sequence[str], failed: Mapping[str, str]) -> None:
        super().__init__(message)
        self.restored, self.failed = list(restored), dict(failed)


class BusError(ServobusError):
    """An exchange on the bus failed. `heard` holds the bytes that came instead of the reply."""

    def __init__(self, message: str, heard: bytes = b"") -> None:
        super().__init__(message)
        self.heard = heard


class NoReply(BusError, TimeoutError):
    """Silence where a reply was due."""


class Garbled(BusError):
    """Bytes came, but they are no packet."""


class BadChecksum(Garbled):
    """A packet of the right shape came, but its checksum is wrong."""


class ShortReply(Garbled):
    """A packet began well and ended too soon."""


class DuplicateId(BusError):
    """One question was answered twice: two servos have one id."""


class BrokenEcho(BusError):
    """The line gives back what is sent, but this time it gave back something else."""


class LineBusy(BusError):
    """Bytes keep coming although nothing was asked: another master, or noise."""


class BadReading(BusError, ValueError):
    """A register reads as what it cannot hold, or as a code without a known meaning, also when asked again.

    `read_raw` gives it as it is.
    """


class OtherProtocol(BusError):
    """A packet of another protocol came, which is not understood here."""


class WrongReply(BusError):
    """A good packet came, but from another servo or to another question."""


class Refused(BusError):
    """The servo understood the request and refused it. `flags` are its error bits."""

    def __init__(self, message: str, flags: int = 0) -> None:
        super().__init__(message)
        self.flags = flags


class Held(ServobusError):
    """Another program or person holds the servo on a port that several share. Nothing was sent; `by` is its name."""

    def __init__(self, message: str, by: str = "") -> None:
        super().__init__(message)
        self.by = by


class RobotMismatch(ServobusError):
    """The servos that answer are not those of the robot file. `findings` tell of each; see `servobus.robot`."""

    def __init__(self, message: str, findings: Sequence[Any]) -> None:
        super().__init__(message)
        self.findings = list(findings)


class MotionError(ServobusError):
    """Motion was refused, ended before its goal was reached, or may go on although it was to end."""


class TorqueOff(MotionError):
    """A move was asked of a servo whose torque is off."""


class OutsideLimits(MotionError):
    """Torque was asked of a servo that stands outside the limits set in it, and would run to the nearest at once."""


class Restarted(MotionError):
    """The servo lost what was set in its RAM: its supply broke down, or it was restarted."""


class Stopped(MotionError):
    """What was under way ended: servos were made safe, by a watch or on the way out, or one was stopped.

    Raised by commands of motion too, as long as nothing is to move.
    """


class StopFailed(MotionError):
    """Some of the servos that were to be stopped may still move. All others were stopped.

    failures  servo, or an id that no known servo has -> why it may still move
    stopped   servo -> what was done with it, as `Bus.stop` gives it
    """

    def __init__(self, message: str, failures: Mapping[Any, Exception], stopped: Mapping[Any, Any]) -> None:
        super().__init__(message)
        self.failures, self.stopped = failures, stopped


class Disagreement(MotionError):
    """Two servos on the axis of one joint stand at different angles of it: they would fight each other."""


class MoveTimeout(MotionError, TimeoutError):
    """A servo did not arrive at its goal in time."""
