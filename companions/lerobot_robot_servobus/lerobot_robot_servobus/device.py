"""What a robot and a leader have in common for LeRobot: a robot file, and its joints once they are connected."""

from typing import Any

from lerobot_robot_servobus.features import Features
from servobus.robots.blocking import Robot as Arm
from servobus.robots.file.reading import read_file


class Device:
    """A base class beside that of LeRobot, which comes second; `config` has `file` and `percent`."""

    def __init__(self, config: Any) -> None:
        super().__init__(config)
        self.config = config
        self.file = read_file(config.file)
        self.features = Features(self.file, config.percent)
        self._arm: Arm | None = None

    @property
    def action_features(self) -> dict[str, type]:
        return self.features.types

    @property
    def is_connected(self) -> bool:
        return self._arm is not None

    @property
    def is_calibrated(self) -> bool:
        return True  # zero, direction and limits stand in the robot file

    def calibrate(self) -> None:
        """Do nothing: `servobus robot calibrate` does it, and the robot file has the result."""

    def configure(self) -> None:
        """Do nothing: `servobus robot apply` writes the settings that the robot file names."""

    def _positions(self) -> dict[str, float]:
        """Read all joints at once. Raises what came instead of the answer of one, after asking it again."""
        assert self._arm is not None
        read = self._arm.positions()
        return self.features.values((self._arm.positions() if read.lost else read).complete())
