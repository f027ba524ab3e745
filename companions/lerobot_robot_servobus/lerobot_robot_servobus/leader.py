"""A robot that is moved by hand, as a teleoperator of LeRobot: it is only read."""

from dataclasses import dataclass, field
from typing import Any

from lerobot.lerobot_types import RobotAction
from lerobot.teleoperators.config import TeleoperatorConfig
from lerobot.teleoperators.teleoperator import Teleoperator
from lerobot.utils.decorators import check_if_already_connected, check_if_not_connected

import servobus
from lerobot_robot_servobus.device import Device
from servobus.robots.blocking import Robot as Arm


@TeleoperatorConfig.register_subclass("servobus_leader")
@dataclass(kw_only=True)
class ServobusLeaderConfig(TeleoperatorConfig):
    """The leader.

    file     path of its robot file
    percent  joints that count 0 .. 100 between their limits; all others count degrees
    """

    file: str
    percent: list[str] = field(default_factory=list)


class ServobusLeader(Device, Teleoperator):
    """A limp robot whose joints are read. Nothing of it is written, and it never moves."""

    config_class = ServobusLeaderConfig
    name = "servobus_leader"

    @property
    def feedback_features(self) -> dict[str, type]:
        return {}

    @check_if_already_connected
    def connect(self, calibrate: bool = True) -> None:  # noqa: ARG002 - there is nothing to calibrate
        """Open the ports and compare the servos with the file. Asks nothing, moves nothing.

        Raises MotionError where the torque is on: switching it off could drop the leader.
        """
        arm = servobus.robot(self.file)
        try:
            _check_limp(arm)
        except BaseException:
            arm.close()
            raise
        self._arm = arm

    @check_if_not_connected
    def get_action(self) -> RobotAction:
        """Read all joints at once. Raises what came instead of the answer of one, after asking it again."""
        return self._positions()

    def send_feedback(self, feedback: dict[str, Any]) -> None:
        """Take nothing: a limp leader cannot push back. Raises UsageError for feedback."""
        if feedback:
            raise servobus.UsageError("a limp leader takes no feedback; `feedback_features` is empty")

    @check_if_not_connected
    def disconnect(self) -> None:
        """Give the ports back."""
        assert self._arm is not None
        arm, self._arm = self._arm, None
        arm.close()


def _check_limp(arm: Arm) -> None:
    states = arm.look()
    stiff = [joint.name for joint in arm if not states[joint.name].limp]
    if stiff:
        raise servobus.MotionError(
            f"{', '.join(stiff)}: the torque of the leader is on, so nobody could move it; hold the leader, and switch "
            "it off"
        )
