"""Values of servos, read again and again: what `read --watch` and `plot` show and keep.

Time counts from the first reading, by the clock of the port.
"""

import csv
from collections.abc import Iterator, Sequence
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from servobus import Bus, BusServo
from servobus.bus.cycle import Result
from servobus.cli.output import note
from servobus.core.present import decoded_json, unit_text
from servobus.core.registers import Register
from servobus.core.values import frozen
from servobus.errors import BusError, UsageError
from servobus.families.present import model_name


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


class Sampler:
    """Reads registers of servos at a fixed rate: iterate over it, and get the samples of each turn.

    A servo that does not answer gives samples without a value, and the others go on; it is asked again, and comes back.
    Nothing moves. Raises UnknownName for a register that one of the servos lacks.
    """

    def __init__(self, bus: Bus, servos: Sequence[BusServo], names: Sequence[str], period: float) -> None:
        self.columns = [(servo, name, _readable(servo, name)) for servo in servos for name in dict.fromkeys(names)]
        self._cycle = bus.cycle(list(dict.fromkeys(names)), write=(), servos=servos)
        self._rate = self._cycle.every(period)

    def until(self, seconds: float | None) -> Iterator[list[Sample]]:
        """Read until so many seconds have passed; None goes on until it is interrupted."""
        for tick in self._rate:
            if seconds is not None and tick.time > seconds:
                return
            yield self._samples(tick.time, self._cycle.run())

    def _samples(self, time: float, seen: Result) -> list[Sample]:
        return [
            Sample(time, servo, name, row, error=seen.lost[servo])  # type: ignore[arg-type] # a cycle loses by BusError
            if servo in seen.lost
            else Sample(time, servo, name, row, seen[servo][name])
            for servo, name, row in self.columns
        ]

    def tell_missed(self) -> None:
        """Note how many turns were left out because the line, or this program, was too slow for the rate."""
        if self._rate.missed:
            note(
                f"{self._rate.missed} readings were left out: the line is too slow for one each {self._rate.period:g} s"
            )


def _readable(servo: BusServo, name: str) -> Register[Any]:
    row = servo.model.register(name)
    if not row.readable:
        raise UsageError(f"{row.model} {row.name} is reserved: it has no meaning")
    return row


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
