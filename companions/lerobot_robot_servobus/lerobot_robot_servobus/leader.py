"""A robot that is moved by hand, as a teleoperator of LeRobot: it is only read."""

from dataclasses import dataclass, field
from typing import Any

from lerobot.lerobot_types import RobotAction
from lerobot.teleoperators.config import TeleoperatorConfig
from lerobot.teleoperators.teleoperator import Teleoperator
from lerobot.utils.decorators import check_if_already_connected, check_if_not_connected

import servobus
from lerobot_robot_servobus.features import Features, complete
from servobus.robots.blocking import Robot as Arm
from servobus.robots.file.reading import read_file


@TeleoperatorConfig.register_subclass("servobus_leader")
@dataclass(kw_only=True)
class ServobusLeaderConfig(TeleoperatorConfig):
    """The leader.

    file     path of its robot file
    percent  joints that count 0 .. 100 between their limits; all others count degrees
    """

    file: str
    percent: list[str] = field(default_factory=list)


class ServobusLeader(Teleoperator):
    """A limp robot whose joints are read. Nothing of it is written, and it never moves."""

    config_class = ServobusLeaderConfig
    name = "servobus_leader"

    def __init__(self, config: ServobusLeaderConfig) -> None:
        super().__init__(config)
        self.config = config
        self.file = read_file(config.file)
        self.features = Features(self.file, config.percent)
        self._arm: Arm | None = None

    @property
    def action_features(self) -> dict[str, type]:
        return self.features.types

    @property
    def feedback_features(self) -> dict[str, type]:
        return {}

    @property
    def is_connected(self) -> bool:
        return self._arm is not None

    @property
    def is_calibrated(self) -> bool:
        return True  # zero, direction and limits stand in the robot file

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

    def calibrate(self) -> None:
        """Do nothing: `servobus robot calibrate` does it, and the robot file has the result."""

    def configure(self) -> None:
        """Do nothing: `servobus robot apply` writes the settings that the robot file names."""

    @check_if_not_connected
    def get_action(self) -> RobotAction:
        """Read all joints at once. Raises what came instead of the answer of one, after asking it again."""
        assert self._arm is not None
        read = self._arm.positions()
        return self.features.values(complete(self._arm.positions() if read.lost else read))

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
    stiff = [joint.name for joint in arm if states[joint.name].torque]
    if stiff:
        raise servobus.MotionError(
            f"{', '.join(stiff)}: the torque of the leader is on, so nobody could move it; hold the leader, and switch "
            "it off"
        )
