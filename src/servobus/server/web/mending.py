"""What can be done at once about a finding: its commands for a shell, as far as the server can do the same.

A finding says what mends it in commands that people can type. Those that the server can carry out itself become
buttons; the others are shown to be typed.
"""

import re
import shlex
from dataclasses import dataclass, field
from typing import Any

from servobus.bus.asyncio import AsyncBusServo
from servobus.core.ids import check_id
from servobus.errors import UnknownName, UsageError
from servobus.families import registry
from servobus.server.web.served_bus import Actor, ServedBus
from servobus.server.web.values import key_of

LOOP = re.compile(r"for id in ([\d ]+); do (.*); done", re.DOTALL)
OPTIONS = "--family", "--baud"
DOES = {
    "rearm": ("Clear and hold", "The alarm is cleared, and the torque comes on where the servo stands."),
    "torque": ("Torque off", "The shaft turns freely then: support what it carries."),
    "set-id": ("Change the id", "Only one servo with the old id may be on the wire. It answers to the new id then."),
    "set-baud": ("Change the speed", "The servo is spoken to at the new speed from then on."),
    "write": ("Write", "The value is written to the servo."),
}
"""Command -> what its button says, and what people should know before."""


@dataclass(frozen=True, slots=True)
class Mend:
    """What mends a finding.

    command  for a shell
    verb     what the server can do itself; "" where it cannot
    ids      the servos that it is done to
    words    what stands behind the id, such as ("off",)
    options  "family", "baud"
    """

    command: str
    verb: str = ""
    ids: tuple[int, ...] = ()
    words: tuple[str, ...] = ()
    options: dict[str, str] = field(default_factory=dict)

    @property
    def label(self) -> str:
        """What its button says."""
        if self.verb in ("set-id", "set-baud"):
            return f"{DOES[self.verb][0]} to {self.words[0]}"
        if self.verb == "write":
            return f"Set {', '.join(self.words).replace('=', ' to ')}"
        return DOES[self.verb][0]

    @property
    def question(self) -> str:
        """What people should know before."""
        return DOES[self.verb][1]


def mend_of(command: str) -> Mend:
    """Read a command for a shell."""
    loop = LOOP.fullmatch(command)
    try:
        words = shlex.split(loop[2] if loop else command)
    except ValueError:
        return Mend(command)
    if len(words) < 4 or words[0] != "servobus" or words[1] not in DOES:
        return Mend(command)
    verb, id, *rest = words[1], *words[3:]
    ids = loop[1].split() if loop and id == "$id" else [id]
    plain: list[str] = []
    options: dict[str, str] = {}
    while rest:
        word = rest.pop(0)
        if word in OPTIONS and rest:
            options[word.removeprefix("--")] = rest.pop(0)
        else:
            plain.append(word)
    fits = {
        "rearm": not plain,
        "torque": plain == ["off"],
        "set-id": len(plain) == 1 and plain[0].isdecimal(),
        "set-baud": len(plain) == 1 and plain[0].isdecimal(),
        "write": bool(plain) and all("=" in word for word in plain),
    }[verb]
    if not fits or not all(one.isdecimal() for one in ids):
        return Mend(command)
    return Mend(command, verb, tuple(map(int, ids)), tuple(plain), options)


async def carry_out(bus: ServedBus, actor: Actor, mend: Mend) -> None:
    """Do what mends a finding, servo by servo. Raises what doing it by hand would raise."""
    for id in mend.ids:
        key = key_of(await _servo(bus, mend, check_id(id)))
        match mend.verb:
            case "rearm":
                await bus.rearm(actor, key)
            case "torque":
                await bus.torque(actor, [key], on=False)
            case "set-id":
                await bus.change_identity(actor, key, int(mend.words[0]), None)
            case "set-baud":
                await bus.change_identity(actor, key, None, int(mend.words[0]))
            case "write":
                values: dict[str, Any] = dict(word.split("=", 1) for word in mend.words)
                await bus.write(actor, key, values, save=False)
            case _:
                raise UsageError(f"this cannot be done from here: {mend.command}")


async def _servo(bus: ServedBus, mend: Mend, id: int) -> AsyncBusServo:
    """Find the servo that is meant; one that is not known yet is looked for. Raises UnknownName."""
    family = registry.family(mend.options["family"]) if "family" in mend.options else None
    baud = int(mend.options["baud"]) if mend.options.get("baud", "").isdecimal() else None

    def fitting() -> list[AsyncBusServo]:
        return [one for one in bus.bus if one.id == id and family in (None, one.family) and baud in (None, one.baud)]

    found = fitting()
    if not found:
        for each in [family] if family is not None else registry.FAMILIES.values():
            await bus.bus.scan(family=each, bauds=[baud] if baud else registry.factory_bauds(each), ids=[id])
        found = fitting()
    if len(found) != 1:
        said = "answers here" if not found else f"is not one servo: {', '.join(map(key_of, found))}"
        raise UnknownName(f"{'no servo with ' if not found else ''}id {id} {said}")
    return found[0]
