"""Making one servo safe: hold it, free it or brake it."""

from servobus.core.exchange import Procedure
from servobus.core.values import replace
from servobus.errors import BusError
from servobus.families.base import Answers, ServoRef
from servobus.families.record import SafeAction


def make_safe(target: ServoRef, action: SafeAction) -> Procedure[None]:
    """Hold a servo where it is, free it or brake it."""
    family, notes = target.model.family, target.notes
    if action == "free":
        yield from family.torque(target, on=False)
        # Most servos do not answer to that: it may have been lost.
        if target.answers is not Answers.NOTHING:
            (torque,) = yield from family.read(target, [target.model.register("torque_enable")])
            if family.torque_on(torque):
                raise BusError(f"{target}: its torque is still on")
    elif action == "brake":
        yield from family.brake(target)
    elif notes is None or not notes.stopped:
        yield from _hold(replace(target, notes=None))  # no limit of one step stands against stopping
    if notes is not None:
        notes.mark_idle()


def _hold(target: ServoRef) -> Procedure[None]:
    family = target.model.family
    try:
        motion_status = yield from family.motion_status(target)
    except BusError:
        pass  # stop it all the same
    else:
        if not motion_status.torque:
            return  # it moves nothing; and a goal would switch an RX-28 on
    yield from family.stop(target)
