"""Which servos a bus knows. A servo is told from all others on its port by its family, its id and its speed.

A servo that is known stays the same object, for a user may hold it: no scan replaces it. What `attach` says of its
model wins over what a scan takes it for.
"""

from collections.abc import Callable, Iterator, Sequence
from typing import Generic, TypeAlias, TypeVar

from servobus.bus.by_servo import pick
from servobus.bus.servo import Servo
from servobus.core.arguments import check_baud
from servobus.core.exchange import Procedure, SetBaud
from servobus.core.ids import check_id
from servobus.core.units import said
from servobus.core.values import replace
from servobus.errors import BadValue, BusError, NoReply, UsageError
from servobus.families.base import Answers, KnownServo, Model, ServoRef, policy_register
from servobus.families.record import ServoRecord
from servobus.jobs.scan import FoundServo, ModelConflict, ScanProblem, ScanResult

S = TypeVar("S", bound=Servo)

_Place: TypeAlias = tuple[str, int, int]
"""Family, id and speed."""


class KnownServos(Generic[S]):
    """The servos known on one port, in the order in which they became known.

    bind      makes the driver's own kind of servo
    prepare   gives it what the bus adds to its permit to move
    """

    def __init__(self, bind: Callable[[KnownServo, str], S], prepare: Callable[[S], None]) -> None:
        self._bind, self._prepare = bind, prepare
        self._servos: list[S] = []
        self._named: set[S] = set()
        """Those whose model `attach` gave."""
        self._speed_assumed: set[S] = set()
        """Those that `attach` was given no speed for, and that no scan has met since."""
        self.alarmed: set[S] = set()
        """Those whose last reply had an alarm in it: as long as there is one, the link tells of every reply."""

    def __iter__(self) -> Iterator[S]:
        return iter(self._servos.copy())

    def __len__(self) -> int:
        return len(self._servos)

    def attach(self, model: type[Model], id: int, baud: int | None, answers: Answers | None, firmware: str) -> S:
        """Name a servo that is there; see `BaseBus.attach`."""
        id = check_id(id)
        baud = None if baud is None else check_baud(baud)
        if answers is not None and answers not in tuple(Answers):
            levels = ", ".join(f"Answers.{level.name}" for level in Answers)
            raise BadValue(f"answers {said(answers)} is none of {levels}")
        answers = None if answers is None else Answers(answers)
        same = [servo for servo in self._servos if (servo.id, servo.family.name) == (id, model.family.name)]
        if baud is not None:
            same = [servo for servo in same if servo.baud == baud]
        old = pick(same, id) if same else None
        if old is not None and old.model is model:
            old.target = replace(old.target, answers=old.target.answers if answers is None else answers)
            old.firmware = firmware or old.firmware
            self._named.add(old)
            return old
        if answers is None:
            policy = policy_register(model)
            answers = Answers.READS if policy is None or policy.default is None else Answers(policy.default)
        assumed = baud is None and (old is None or old in self._speed_assumed)
        if old is not None and not assumed:
            baud = old.baud  # where it was met; one that was only assumed goes with the model
        servo = self._know(ServoRef(id, model, answers), baud or model.factory_baud, firmware, old)
        self._named.add(servo)
        if assumed:
            self._speed_assumed.add(servo)
        return servo

    def forget(self, servo: S) -> None:
        """Know this one no more. Raises UsageError if it is driven, for nothing would stop it then."""
        if servo.permit.driven:
            raise UsageError(
                f"{servo.target} is driven by this bus, which would not stop it any more: torque_off() first"
            )
        self._drop(servo)
        servo.permit.inhibited = f"{servo.target} was forgotten by its bus; attach() makes another object of it"

    def attached_model(self, family: str, id: int, baud: int) -> type[Model] | None:
        """Give the model that `attach` gave a servo that is there, or that may be but for its assumed speed."""
        named = [servo for servo in self._named if _place(servo) == (family, id, baud)]
        assumed = [servo for servo in self._speed_assumed if _place(servo)[:2] == (family, id)]
        return next((servo.model for servo in named + assumed), None)

    def model_at(self, family: str, id: int, baud: int) -> type[Model] | None:
        """Give the model of the servo that is known there."""
        return next((servo.model for servo in self._servos if _place(servo) == (family, id, baud)), None)

    def adopt(self, found: FoundServo, survey: ScanResult) -> S | None:
        """Know a servo that a scan has found, as it was seen then; None for a model that is not known here.

        What contradicts the model that `attach` gave is put into the survey.
        """
        if found.model is None:
            return None
        identity = found.identity
        servo = next((servo for servo in self._servos if _place(servo) == _found_at(found)), None)
        if servo is None:
            servo = self._know(ServoRef(found.id, found.model, identity.answers), found.baud)
        if servo.model is not found.model and servo in self._named:
            survey.conflicts.append(ModelConflict(servo.target, found))
        elif servo.model is not found.model:
            # Another one is in its place now, and says so: what was written to the old one tells nothing of it.
            servo.target = replace(servo.target, model=found.model, record=ServoRecord())
        servo.target = replace(servo.target, answers=identity.answers)
        servo.firmware = identity.firmware or servo.firmware
        self._speed_assumed.discard(servo)
        servo.state = found.state if servo.model is found.model else None
        self.note_alarms(servo, found.alarms)
        return servo

    def note_alarms(self, servo: S, alarms: int) -> None:
        """Keep the alarm bits of a servo's last reply."""
        servo.note_alarms(alarms)
        (self.alarmed.add if alarms else self.alarmed.discard)(servo)

    def adopt_all(self, all_found: Sequence[FoundServo], survey: ScanResult) -> Procedure[list[S]]:
        """Know all that a scan has found.

        A servo whose speed was assumed by `attach`, and that does not answer there, is taken to be the one that was
        found at another speed.
        """
        met = {_found_at(found) for found in all_found}
        for found in all_found:
            for servo in self._assumed_elsewhere(found):
                if _place(servo) in met:
                    continue
                yield SetBaud(servo.baud)
                try:
                    yield from servo.family.ping(servo.id)
                except NoReply:
                    servo.target = replace(servo.target, baud=found.baud)
                except BusError as error:  # something answers there, but not clearly: it stays where it was taken to be
                    survey.troubles.append(ScanProblem(servo.family, servo.id, servo.baud, error))
                self._speed_assumed.discard(servo)
        if all_found:
            yield SetBaud(all_found[-1].baud)
        adopted = [self.adopt(found, survey) for found in all_found]
        return [servo for servo in adopted if servo is not None]

    def adopt_found(self, survey: ScanResult) -> None:
        """Know what a scan has found that was broken off, without asking anything more."""
        for found in survey.found:
            self.adopt(found, survey)

    def _assumed_elsewhere(self, found: FoundServo) -> list[S]:
        """Give those that may be the one that was found, but for a speed that was only assumed."""
        if any(_place(servo) == _found_at(found) for servo in self._servos):
            return []
        return [servo for servo in self._speed_assumed if _place(servo)[:2] == _found_at(found)[:2]]

    def _know(self, ref: ServoRef, baud: int, firmware: str = "", old: S | None = None) -> S:
        """Know another servo, in place of an old one if there is one: what was chosen for that holds for it too."""
        servo = self._bind(KnownServo.of(ref, baud), firmware)
        self._prepare(servo)
        if old is None:
            self._servos.append(servo)
            return servo
        # It is the same servo on the wire: what drives it goes on, and a stop must still find it.
        permit, before = servo.permit, old.permit
        permit.max_step, permit.safe_action, permit.inhibited = before.max_step, before.safe_action, before.inhibited
        permit.driven, permit.stopped = before.driven, before.stopped
        before.driven = False
        self._servos.insert(self._servos.index(old), servo)
        self._drop(old)
        old.permit.inhibited = f"{old.target} is attached as {ref} now: use the servo that attach() gave"
        return servo

    def _drop(self, servo: S) -> None:
        self._servos.remove(servo)
        self._named.discard(servo)
        self._speed_assumed.discard(servo)
        self.alarmed.discard(servo)


def _place(servo: Servo) -> _Place:
    return servo.family.name, servo.id, servo.baud


def _found_at(found: FoundServo) -> _Place:
    return found.family.name, found.id, found.baud
