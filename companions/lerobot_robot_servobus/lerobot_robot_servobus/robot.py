"""A robot of servobus as a robot of LeRobot."""

from dataclasses import dataclass, field

from lerobot.cameras import CameraConfig, make_cameras_from_configs
from lerobot.lerobot_types import RobotAction, RobotObservation
from lerobot.robots.config import RobotConfig
from lerobot.robots.robot import Robot
from lerobot.utils.decorators import check_if_already_connected, check_if_not_connected

import servobus
from lerobot_robot_servobus.driving import Driving
from lerobot_robot_servobus.features import Features, complete
from servobus.robots.blocking import Robot as Arm
from servobus.robots.file.reading import read_file


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


class ServobusRobot(Robot):
    """The joints of a robot file, read and led at the rate of LeRobot."""

    config_class = ServobusRobotConfig
    name = "servobus"

    def __init__(self, config: ServobusRobotConfig) -> None:
        super().__init__(config)
        self.config = config
        self.file = read_file(config.file)
        self.features = Features(self.file, config.percent)
        self.cameras = make_cameras_from_configs(config.cameras)
        self._arm: Arm | None = None
        self._driving: Driving | None = None

    @property
    def observation_features(self) -> dict[str, type | tuple[int, ...]]:
        images = {name: (camera.height, camera.width, 3) for name, camera in self.cameras.items()}
        return {**self.features.types, **images}

    @property
    def action_features(self) -> dict[str, type]:
        return self.features.types

    @property
    def is_connected(self) -> bool:
        return self._arm is not None

    @property
    def is_calibrated(self) -> bool:
        return True  # zero, direction and limits stand in the robot file

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

    def calibrate(self) -> None:
        """Do nothing: `servobus robot calibrate` does it, and the robot file has the result."""

    def configure(self) -> None:
        """Do nothing: `servobus robot apply` writes the settings that the robot file names."""

    @check_if_not_connected
    def get_observation(self) -> RobotObservation:
        """Read all joints at once, and take the latest pictures. A joint that does not answer is asked once more."""
        assert self._arm is not None
        read = self._arm.positions()
        seen = self.features.values(complete(self._arm.positions() if read.lost else read))
        return {**seen, **{name: camera.read_latest() for name, camera in self.cameras.items()}}

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
