"""What the demo does on one bus: scan, follow a sine wave, come to rest."""

import math
import threading
import time
from dataclasses import dataclass, field
from types import TracebackType
from typing import Self

import servobus
from servobus import Bus, BusServo
from servobus.core.units import deg
from servobus.families.base import Model

STEP_TIME = 0.2
"""s between two moves; each leads to where the wave will be at the next step."""
PERIOD = 4.0
"""s of one wave."""
SWING = 80 * deg
"""How far a wave goes to either side. With PERIOD it makes 126°/s at most, which all models reach."""
READS_PER_STEP = 3
"""How often positions are read between two moves."""
APPROACH = 1.2
"""s of the moves that lead to the wave's start and back to the middle."""


@dataclass
class Track:
    """Where one servo is, and where it is going, rad."""

    position: float
    goal: float


@dataclass
class DemoBus:
    """One bus with servos of one family, driven by a thread of its own."""

    port: str
    model: type[Model]
    ids: range
    """Ids to ask in the scan."""
    tracks: dict[int, Track] = field(default_factory=dict)
    moves: int = 0
    failure: BaseException | None = None

    def __enter__(self) -> Self:
        self.bus: Bus = servobus.open(self.port, models=self.model)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.bus.close()

    @property
    def middle(self) -> float:
        """Middle of the model's range to the degree, rad."""
        row = self.model.register("goal_position")
        low, high = (float(row.decode(limit)) for limit in row.limits)
        return round((low + high) / 2 / deg) * deg

    def scan(self) -> list[BusServo]:
        servos = self.bus.scan(family=self.model.family, ids=self.ids)
        self.read_positions()
        return servos

    def read_positions(self) -> None:
        """Read where all servos are."""
        for id, position in self.bus.read_all("present_position").by_id().items():
            old = self.tracks.get(id)
            self.tracks[id] = Track(position, old.goal if old else position)

    def follow_wave(self, seconds: float, stop: threading.Event) -> None:
        """Follow the wave for so many s, then rest in the middle. Torque is switched off whatever happens."""
        try:
            with self.bus.torque():
                self._go(self._wave(0.0), APPROACH, stop)
                start = time.monotonic()
                while (now := time.monotonic() - start) < seconds and not stop.is_set():
                    step = (math.floor(now / STEP_TIME) + 1) * STEP_TIME
                    self._move(self._wave(step), max(step - now, STEP_TIME / 4))
                    for read in range(READS_PER_STEP):
                        self.read_positions()
                        stop.wait(
                            max(
                                0.0,
                                (step - (READS_PER_STEP - 1 - read) * STEP_TIME / READS_PER_STEP)
                                - (time.monotonic() - start),
                            )
                        )
                self._go(dict.fromkeys(self.tracks, self.middle), APPROACH, stop)
        except BaseException as error:  # noqa: BLE001 - the main thread raises it
            self.failure = error
            stop.set()

    def _wave(self, moment: float) -> dict[int, float]:
        """Tell where each servo should be: the same wave, a little later for each."""
        return {
            id: self.middle + SWING * math.sin(2 * math.pi * moment / PERIOD - place * math.pi / 3)
            for place, id in enumerate(self.tracks)
        }

    def _go(self, goals: dict[int, float], seconds: float, stop: threading.Event) -> None:
        """Move, read positions until the move is over, and make sure that all arrived."""
        if stop.is_set():
            return
        move = self._move(goals, seconds)
        end = time.monotonic() + seconds
        while time.monotonic() < end and not stop.wait(STEP_TIME / READS_PER_STEP):
            self.read_positions()
        if not stop.is_set():
            move.wait()
        self.read_positions()

    def _move(self, goals: dict[int, float], seconds: float) -> servobus.Move:
        for id, goal in goals.items():
            self.tracks[id].goal = goal
        self.moves += 1
        return self.bus.move(goals, time=seconds)
