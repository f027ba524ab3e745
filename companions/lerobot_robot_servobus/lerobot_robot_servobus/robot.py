"""A robot of servobus as a robot of LeRobot."""

from dataclasses import dataclass, field

from lerobot.cameras import CameraConfig, make_cameras_from_configs
from lerobot.lerobot_types import RobotAction, RobotObservation
from lerobot.robots.config import RobotConfig
from lerobot.robots.robot import Robot
from lerobot.utils.decorators import check_if_already_connected, check_if_not_connected

import servobus
from lerobot_robot_servobus.device import Device
from lerobot_robot_servobus.driving import Driving


@RobotConfig.register_subclass("servobus")
@dataclass(kw_only=True)
class ServobusRobotConfig(RobotConfig):
    """The robot.

    file     path of its robot file
    percent  joints that count 0 .. 100 between their limits, such as a gripper; all others count degrees
    release  whether at the end it goes to the pose `rest` of its file, if there is one, and its torque goes off;
             without this it stays as its file says under `safe_action`, which is to hold
    cameras  name -> camera, as with the robots of LeRobot
    """

    file: str
    percent: list[str] = field(default_factory=list)
    release: bool = False
    cameras: dict[str, CameraConfig] = field(default_factory=dict)


class ServobusRobot(Device, Robot):
    """The joints of a robot file, read and led at the rate of LeRobot."""

    config_class = ServobusRobotConfig
    name = "servobus"

    def __init__(self, config: ServobusRobotConfig) -> None:
        super().__init__(config)
        self.cameras = make_cameras_from_configs(config.cameras)
        self._driving: Driving | None = None

    @property
    def observation_features(self) -> dict[str, type | tuple[int, ...]]:
        images = {name: (camera.height, camera.width, 3) for name, camera in self.cameras.items()}
        return {**self.features.types, **images}

    @check_if_already_connected
    def connect(self, calibrate: bool = True) -> None:  # noqa: ARG002 - there is nothing to calibrate
        """Open the ports and the cameras, and compare the servos with the file. Asks nothing, moves nothing.

        The torque stays as it is until the first action. Raises RobotMismatch and PortError.
        """
        arm = servobus.robot(self.file)
        opened = []
        try:
            for camera in self.cameras.values():
                camera.connect()
                opened.append(camera)
        except BaseException:
            for camera in opened:
                camera.disconnect()
            arm.close()
            raise
        self._arm, self._driving = arm, Driving(arm)

    @check_if_not_connected
    def get_observation(self) -> RobotObservation:
        """Read all joints at once, and take the latest pictures. A joint that does not answer is asked once more."""
        return {**self._positions(), **{name: camera.read_latest() for name, camera in self.cameras.items()}}

    @check_if_not_connected
    def send_action(self, action: RobotAction) -> RobotAction:
        """Send goals, and give what was really sent: within limits of angle, speed and acceleration.

        Raises what ended the motion, after all joints were stopped.
        """
        assert self._driving is not None
        return self.features.values(self._driving.lead(self.features.angles(action)))

    @check_if_not_connected
    def disconnect(self) -> None:
        """Stop, make the robot safe, and give ports and cameras back: each of these though another fails."""
        assert self._arm is not None
        assert self._driving is not None
        arm, driving = self._arm, self._driving
        self._arm = self._driving = None
        try:
            driving.end(release=self.config.release)
        finally:
            try:
                arm.close()
            finally:
                for camera in self.cameras.values():
                    camera.disconnect()
