"""Values of servos, read again and again: what `read --watch` and `plot` show and keep.

Time counts from the first reading, by the clock of the port.
"""

import csv
import itertools
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from servobus import Bus, BusServo, ServobusError
from servobus.bus.cycle import Result
from servobus.cli.finding import Where, search
from servobus.cli.output import note
from servobus.cli.values import Ids, readable
from servobus.core.present import decoded_json, unit_text
from servobus.core.registers import Register
from servobus.core.values import frozen
from servobus.errors import BusError, NoReply, UsageError
from servobus.families.present import model_name
from servobus.jobs.scan import ScanResult, scan

LOOK_PERIOD = 1.0
"""s between two looks for ids that have not answered yet, in one family each time: a look takes up to 0.2 s."""


@frozen
class Sample:
    """One register of one servo at one moment. `error` says why there is no value."""

    time: float
    servo: BusServo
    name: str
    row: Register[Any]
    value: Any = None
    error: BusError | None = None

    @property
    def shown(self) -> Any:
        """The value for programs, in the unit that people use; None if there is none."""
        return None if self.error is not None else decoded_json(self.row, self.value)

    def __str__(self) -> str:
        return "no answer" if self.error is not None else self.row.show(self.value)


class Latecomers:
    """Ids that nobody answered to at the start, and that are looked for again and again."""

    def __init__(self, bus: Bus, where: Where, missing: Mapping[int, ServobusError]) -> None:
        self.missing = dict(missing)
        self._bus, self._where = bus, where
        self._rounds = itertools.cycle(where.rounds())
        self._due = bus.transport.now() + LOOK_PERIOD

    def look(self) -> list[BusServo]:
        """Look for them if it is time to; give those that answer now."""
        bus, result = self._bus, ScanResult()
        if not self.missing or bus.transport.now() < self._due:
            return []
        family, bauds = next(self._rounds)
        bus.do(scan([family], bauds, list(self.missing), None, result, bus.identify))
        self._due = bus.transport.now() + LOOK_PERIOD
        servos = []
        for servo in filter(None, map(bus.adopt, result.found)):
            with suppress(UsageError):  # another model than is asked for: it stays missing
                servos.append(self._where.checked(servo))
                self.missing.pop(servo.id, None)
        return servos


class Sampler:
    """Reads registers of servos at a fixed rate: iterate over it, and get the samples of each turn.

    A servo that does not answer gives samples without a value, and the others go on; it is asked again, and comes back.
    What makes no sense is asked for once more at once. A servo that is not there at the start is noted, and joins in
    when it answers. Nothing moves. Raises UnknownName for a register that one of the servos lacks, ServobusError if no
    servo is there.
    """

    def __init__(self, bus: Bus, where: Where, ids: Ids, names: Sequence[str], period: float) -> None:
        found = search(bus, where, ids)
        errors = found.failures(bus, where)
        if not found.servos:
            raise errors[0]
        self._bus, self._names = bus, list(dict.fromkeys(names))
        self._servos: list[BusServo] = []
        self.columns: list[tuple[BusServo, str, Register[Any]]] = []
        """Servo, name as it was typed, and register; those of latecomers are added at the end."""
        self._take(found.servos)
        self._rate = self._cycle.every(period)
        for error in errors:
            note(f"servobus: {error}")
        self._latecomers = Latecomers(bus, where, found.missing)

    def _take(self, servos: Sequence[BusServo]) -> None:
        self.columns += [(servo, name, readable(servo.model, name)) for servo in servos for name in self._names]
        self._servos += servos
        self._cycle = self._bus.cycle(self._names, write=(), servos=self._servos)

    def until(self, seconds: float | None) -> Iterator[list[Sample]]:
        """Read until so many seconds have passed; None goes on until it is interrupted."""
        for tick in self._rate:
            if seconds is not None and tick.time > seconds:
                return
            if late := self._latecomers.look():
                note(f"{', '.join(str(servo.target) for servo in late)}: answers now")
                self._take(late)
            yield self._samples(tick.time, self._cycle.run())

    def _samples(self, time: float, seen: Result) -> list[Sample]:
        read: dict[BusServo, Mapping[str, Any] | BusError] = {
            servo: self._second_look(servo, seen.lost[servo]) if servo in seen.lost else seen[servo]  # type: ignore[arg-type] # a cycle loses by BusError
            for servo in self._servos
        }
        return [
            Sample(time, servo, name, row, error=one)
            if isinstance(one := read[servo], BusError)
            else Sample(time, servo, name, row, one[name])
            for servo, name, row in self.columns
        ]

    def _second_look(self, servo: BusServo, error: BusError) -> Mapping[str, Any] | BusError:
        """Read a servo alone whose answer made no sense: a watch has time for that, and a control loop has not."""
        if isinstance(error, NoReply):
            return error
        try:
            return servo.read_many(self._names)
        except BusError as again:
            return again

    def tell_end(self) -> None:
        """Note how many turns were left out because the line, or this program, was too slow for the rate.

        Raises NoReply for ids that have never answered.
        """
        if self._rate.missed:
            note(
                f"{self._rate.missed} readings were left out: the line is too slow for one each {self._rate.period:g} s"
            )
        if missing := self._latecomers.missing:
            raise NoReply(f"{self._bus.transport.name}: id {', '.join(map(str, missing))} has never answered")


class CsvFile:
    """A table of samples, a line each: time, model, id, register, value, unit. No value means that none came.

    Each line is in the file at once, so what was kept survives whatever ends the program.
    """

    HEAD = ("time", "model", "id", "register", "value", "unit")

    def __init__(self, path: Path) -> None:
        try:
            self._file = path.open("x", encoding="utf-8", newline="", buffering=1)
        except FileExistsError:
            raise UsageError(f"{path} exists already and is not replaced; choose another name") from None
        self._table = csv.writer(self._file, lineterminator="\n")
        self._table.writerow(self.HEAD)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._file.close()

    def write(self, samples: Sequence[Sample]) -> None:
        """Add the samples of one turn."""
        for one in samples:
            value = "" if one.shown is None else one.shown
            self._table.writerow(
                (
                    f"{one.time:.6f}",
                    model_name(one.servo.model) or "",
                    one.servo.id,
                    one.name,
                    value,
                    unit_text(one.row),
                )
            )
