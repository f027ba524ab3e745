"""Making one servo safe: hold it, free it or brake it."""

from servobus.core.exchange import Procedure
from servobus.errors import BusError
from servobus.families.base import Answers, KnownServo, ServoRef
from servobus.families.record import SafeAction


def make_safe(target: KnownServo, action: SafeAction) -> Procedure[None]:
    """Hold a servo where it is, free it or brake it."""
    family = target.model.family
    if action == "free":
        yield from family.torque(target, on=False)
        # Most servos do not answer to that: it may have been lost.
        if target.answers is not Answers.NOTHING:
            (torque,) = yield from family.read(target, [target.model.register("torque_enable")])
            if family.torque_on(torque):
                raise BusError(f"{target}: its torque is still on")
    elif action == "brake":
        yield from family.brake(target)
    elif not target.permit.stopped:
        yield from _hold(target)
    target.permit.mark_idle()


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
