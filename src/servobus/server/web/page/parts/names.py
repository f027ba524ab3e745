"""What people call servos: by their joint where a robot file names it, else by model and id."""

from collections.abc import Iterable, Mapping
from typing import Any

from servobus.server.web.service import Service


def joints(robots: Iterable[Mapping[str, Any]]) -> dict[tuple[str, str], str]:
    """Give the names that robots, as `ServedRobot.entry` gives them, have for servos: bus and key -> joint."""
    return {
        (servo["bus"], servo["key"]): joint if len(entry["servos"]) == 1 else f"{joint} {number}"
        for robot in robots
        for joint, entry in robot["joints"].items()
        for number, servo in enumerate(entry["servos"], 1)
    }


def titles(service: Service) -> dict[tuple[str, str], str]:
    """Give what all known servos are called: bus and key -> name."""
    named = joints(robot.entry() for robot in service.robots.values())
    return {
        (bus.name, entry["key"]): named.get((bus.name, entry["key"])) or f"{entry['title']} {entry['id']}"
        for bus in service.buses.values()
        for entry in bus.servo_entries()
    }
