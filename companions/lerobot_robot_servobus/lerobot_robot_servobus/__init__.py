"""Robots and leaders of servobus for LeRobot: `--robot.type=servobus`, `--teleop.type=servobus_leader`."""

from lerobot_robot_servobus.leader import ServobusLeader, ServobusLeaderConfig
from lerobot_robot_servobus.robot import ServobusRobot, ServobusRobotConfig

__all__ = ["ServobusLeader", "ServobusLeaderConfig", "ServobusRobot", "ServobusRobotConfig"]
