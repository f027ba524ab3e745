"""One servo on the page: what it has, what is to be changed, and what was changed last."""

from collections.abc import Callable
from typing import Any

from servobus.core.registers import Register
from servobus.core.values import frozen
from servobus.errors import BadValue, ServobusError, UsageError
from servobus.server.web.auth import FRESH
from servobus.server.web.page.context import PageContext
from servobus.server.web.page.parts import toast
from servobus.server.web.page.settings.draft import Draft, Writes
from servobus.server.web.served_bus import ServedBus
from servobus.server.web.values import key_of


@frozen
class Outcome:
    """What came of writing one register.

    taken  whether it was read back as asked for; None where nothing can be read
    """

    row: Register[Any]
    text: str
    taken: bool | None


class Workbench:
    """What the parts of the page share.

    context    the page
    bus, key   the servo
    lacking    registers that this servo lacks
    """

    def __init__(self, context: PageContext, bus: ServedBus, key: str) -> None:
        self.context, self.bus = context, bus
        servo = bus.servo(key)
        self.key, self.id, self.baud = key_of(servo), servo.id, servo.baud
        self.model, self.firmware = servo.model, servo.firmware
        self.draft = Draft(servo.model, {})
        self.lacking: set[str] = set()
        self._undo: Writes = ()
        self._shown: list[Callable[[], object]] = []

    @property
    def may_change(self) -> bool:
        return self.context.may_change

    @property
    def can_undo(self) -> int:
        """How many values the last change can bring back."""
        return len({name for _, values in self._undo for name in values})

    def shown(self, show: Callable[[], object]) -> None:
        """Have a function called when an edit or what was read has changed."""
        self._shown.append(show)

    def show(self) -> None:
        for show in self._shown:
            show()

    async def read(self) -> bool:
        """Read the whole table; tells whether that went well. Edits stay."""
        table = await self.context.attempt(self.bus.held(self.key))
        if table is None:
            return False
        self.lacking = {row.name for row, held in table.items() if held.now is None}
        self.draft.learn({row.name: held for row, held in table.items()})
        self.show()
        return True

    def require(self, *, fresh: bool = False) -> None:
        """Raise UsageError for a login that may not change anything, or that is too old for what stays; see `Guard`."""
        context = self.context
        if not context.may_change:
            raise UsageError(f"{context.login.name} may look and stop, and change nothing")
        application = context.application
        old = application.authority.now() > context.login.began + FRESH
        if fresh and old and context.login.kind == "browser" and not application.config.loopback:
            raise UsageError(f"this needs a login of the last {FRESH / 60:.0f} min: log in again, then repeat it")

    # Edits

    def type(self, name: str, text: str) -> str:
        """Take what was typed; gives what is wrong with it, "" if nothing."""
        try:
            self.draft.type(name, text)
        except BadValue as error:
            return str(error)
        self.show()
        return ""

    def set(self, name: str, raw: int) -> None:
        """Take a raw value that can be chosen."""
        self.context.attempt_now(lambda: self.draft.set(name, raw))
        self.show()

    def drop(self, name: str) -> None:
        self.draft.undo(name)
        self.show()

    def clear(self) -> None:
        self.draft.clear()
        self.show()

    def forget_undo(self) -> None:
        self._undo = ()
        self.show()

    # Writing

    async def apply(self, *, keep: bool) -> list[Outcome]:
        """Carry the edits out, and read everything back. What could not be written stays an edit."""
        writes, self._undo = self.draft.writes(keep=keep), self.draft.undoing(keep=keep)
        outcomes = await self._write(writes)
        for one in outcomes:
            if one.taken is not False:
                self.draft.undo(one.row.name)
        await self.read()
        return outcomes

    async def undo(self) -> list[Outcome]:
        """Bring back what the last change has replaced."""
        writes, self._undo = self._undo, ()
        outcomes = await self._write(writes)
        await self.read()
        return outcomes

    async def _write(self, writes: Writes) -> list[Outcome]:
        outcomes: list[Outcome] = []
        for save, values in writes:
            try:
                self.require()
                result = await self.bus.write(self.context.actor, self.key, values, save=save)
            except ServobusError as error:
                with self.context.content:
                    toast.failed(error)
                break
            for name, change in result["changes"].items():
                row = self.model.register(name)
                outcomes.append(Outcome(row, change["text"], change["taken"]))
        return outcomes
