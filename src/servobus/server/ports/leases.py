"""Who may move which servo, and which servos a stop has forbidden to move.

Two programs that command one servo fight each other, and neither can tell why the servo does not obey. So a servo has
one holder at most: the one that has a lease of it. Reading needs none.

    state  meaning                      drive by the holder  drive by another  take         take over     end
    FREE   nobody holds the servo       -                    HELD, by it       HELD         HELD          -
    HELD   one holder; all others read  -                    Held is raised    Held raised  HELD, by it   FREE

A stop is for everybody, whoever holds a servo. What it has stopped stays forbidden to move, so that a program that
sends one goal after the other does not start it again, until somebody allows it again on purpose.

Nothing here talks to a servo or waits: `Leases` and `StopLatch` decide, and the caller carries out what follows.
"""

from collections.abc import Callable, Hashable, Iterable
from typing import Generic, Protocol, TypeVar

from servobus.core.values import frozen
from servobus.errors import Held, Stopped


class Holder(Protocol):
    """Who can hold servos: a session of a program, a page, or a port for a program of another make."""

    @property
    def name(self) -> str:
        """What people know it by."""
        ...


K = TypeVar("K", bound=Hashable)


class Leases(Generic[K]):
    """The holders of the servos of all ports.

    changed  told of each servo that has another holder now, or none
    """

    def __init__(self, changed: Callable[[K, Holder | None], object]) -> None:
        self._changed = changed
        self._holders: dict[K, Holder] = {}

    def __repr__(self) -> str:
        return (
            f"<leases: {', '.join(f'{key} held by {holder.name}' for key, holder in self._holders.items()) or 'none'}>"
        )

    def holder(self, servo: K) -> Holder | None:
        """Give who holds a servo."""
        return self._holders.get(servo)

    def all(self) -> dict[K, Holder]:
        """Give all servos that somebody holds, with who does."""
        return dict(self._holders)

    def held_by(self, holder: Holder) -> list[K]:
        """Give the servos that one holds."""
        return [servo for servo, other in self._holders.items() if other is holder]

    def check(self, who: Holder, servos: Iterable[K]) -> None:
        """Raise Held if another one than `who` holds one of these servos."""
        for servo in servos:
            holder = self._holders.get(servo)
            if holder is not None and holder is not who:
                raise Held(
                    f"{servo} is held by {holder.name}: {who.name} may read it; take the lease over to command it",
                    holder.name,
                )

    def take(self, who: Holder, servos: Iterable[K]) -> None:
        """Have `who` hold these servos: all of them, or none. Raises Held if another one holds one of them."""
        wanted = list(servos)
        self.check(who, wanted)
        self._set(who, wanted)

    def take_over(self, who: Holder, servos: Iterable[K]) -> dict[K, Holder]:
        """Have `who` hold these servos, whoever held them; give those that another one held, with that one.

        What the other one has set in motion is the caller's to stop: nobody answers for it any more.
        """
        wanted = list(servos)
        lost = {servo: holder for servo in wanted if (holder := self._holders.get(servo, who)) is not who}
        self._set(who, wanted)
        return lost

    def end(self, who: Holder, servos: Iterable[K] | None = None) -> list[K]:
        """End the leases that `who` has, of these servos or of all; give those that ended."""
        mine = self.held_by(who)
        wanted = set(mine if servos is None else servos)
        ended = [servo for servo in mine if servo in wanted]
        for servo in ended:
            del self._holders[servo]
            self._changed(servo, None)
        return ended

    def rename(self, old: K, new: K) -> None:
        """Take note that a servo has another id or speed now: its lease goes with it."""
        holder = self._holders.pop(old, None)
        if holder is not None:
            self._holders[new] = holder
            self._changed(old, None)
            self._changed(new, holder)

    def _set(self, who: Holder, servos: Iterable[K]) -> None:
        for servo in servos:
            if self._holders.get(servo) is not who:
                self._holders[servo] = who
                self._changed(servo, who)


@frozen
class Stop:
    """A stop that still forbids motion. `by` is who asked for it, `time` when, in s of the caller's clock."""

    by: str
    time: float


class StopLatch(Generic[K]):
    """What must not move on one port, since somebody stopped it.

    A stop of the whole port holds for servos too that nobody has met yet.
    """

    def __init__(self) -> None:
        self._all: Stop | None = None
        self._servos: dict[K, Stop] = {}

    def __repr__(self) -> str:
        what = "all" if self._all is not None else ", ".join(map(str, self._servos)) or "nothing"
        return f"<stopped: {what}>"

    def stop(self, by: str, now: float, servos: Iterable[K] | None = None) -> None:
        """Forbid these servos to move, or every one on the port."""
        if servos is None:
            self._all = Stop(by, now)
        else:
            self._servos.update((servo, Stop(by, now)) for servo in servos)

    def stopped(self, servo: K | None = None) -> Stop | None:
        """Give the stop that forbids a servo to move, or that of the whole port; None if it may."""
        return self._all or (None if servo is None else self._servos.get(servo))

    @property
    def servos(self) -> list[K]:
        """The servos that were stopped one by one."""
        return list(self._servos)

    def resume(self, servos: Iterable[K] | None = None) -> None:
        """Allow motion again: of the whole port, or of these servos where they were stopped one by one."""
        if servos is None:
            self._all = None
            self._servos.clear()
        else:
            for servo in servos:
                self._servos.pop(servo, None)

    def check(self, servos: Iterable[K]) -> None:
        """Raise Stopped if one of these servos must not move."""
        for servo in servos:
            stop = self.stopped(servo)
            if stop is not None:
                raise Stopped(f"{servo} was stopped by {stop.by} and must not move until somebody resumes it")
