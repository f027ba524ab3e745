"""A robot of virtual servos that other programs find behind ports, each served by a thread of this process.

with serve_robot(read_file("arm.toml")) as arm:
    program_under_test(arm.path)        # a robot file with the ports that are served, and all else as in the file
    arm.servos["shoulder"][0].block()
    arm.ports["left"].inject("drop=0.01")
"""

import sys
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager
from itertools import count
from pathlib import Path
from typing import Any

from servobus.core.values import frozen
from servobus.errors import PortError
from servobus.robots.file.entries import RobotFile
from servobus.robots.file.places import for_file
from servobus.robots.file.writing import edited
from servobus.robots.virtual.building import VirtualRobot, build_robot
from servobus.transports.file_lock import replace_text
from servobus.virtual.serve.background import ServedPort, ServedServo, serving
from servobus.virtual.serve.ports import Port, PtyPort, TcpPort

MARK = "# Ports of virtual servos, written by servobus; it goes when they are switched off.\n"
"""First line of a robot file that names what is served: such a file may be replaced."""


@frozen
class ServedRobot:
    """A robot that is being served.

    path    of a robot file that names the ports served; all else is as in the robot's own
    ports   port -> its name, for whatever opens serial ports, and a handle to what is behind it
    servos  joint -> its servos: what is true of them, and what can be done to them
    robot   what is served
    """

    path: Path
    ports: Mapping[str, ServedPort]
    servos: Mapping[str, tuple[ServedServo, ...]]
    robot: VirtualRobot


@contextmanager
def serve_robot(
    file: RobotFile,
    *,
    folder: Path | None = None,
    tcp: tuple[str, int] | None = None,
    said: Mapping[str, Any] | None = None,
) -> Iterator[ServedRobot]:
    """Serve the servos of a robot file, all of them virtual, each port on a pseudo terminal of its own.

    folder  where the links to the terminals are made, named as the ports, and the robot file; a temporary one if None
    tcp     host and port: serve on TCP ports from this one on, or on any free ones if it is 0. On Windows always
    said    what surrounds the servos, as fields of `servobus.virtual.serve.spec.Setup`

    Raises UsageError for what cannot be served, PortError.
    """
    with ExitStack() as stack:
        where = folder or Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="servobus-")))
        path = where / ("robot.toml" if file.path is None else file.path.name)
        _may_be_written(path)
        robot = build_robot(file, said)
        stack.callback(robot.close)
        where.mkdir(parents=True, exist_ok=True)
        numbers = count(tcp[1]) if tcp and tcp[1] else None
        ports: dict[str, ServedPort] = {}
        for name, rig in robot.rigs.items():
            if tcp or sys.platform == "win32":
                port: Port = TcpPort(rig, tcp[0] if tcp else "127.0.0.1", next(numbers) if numbers else 0)
            else:
                port = PtyPort(rig, where / name)
            ports[name] = stack.enter_context(serving(port))
        paths: dict[tuple[str, ...], str] = {
            ("port", name, "path"): for_file(str(port), where) for name, port in ports.items()
        }
        replace_text(path, MARK + edited(file, paths))
        stack.callback(path.unlink, missing_ok=True)
        yield ServedRobot(
            path,
            ports,
            {
                joint.name: tuple(
                    ServedServo(ports[entry.port], servo)
                    for entry, servo in zip(joint.servos, robot.servos[joint.name], strict=True)
                )
                for joint in file.joints.values()
            },
            robot,
        )


def _may_be_written(path: Path) -> None:
    """Raise PortError for a file that is somebody else's."""
    try:
        if not path.read_text(encoding="utf-8").startswith(MARK):
            raise PortError(f"{path} is there already, and would be replaced; name another folder for the ports")
    except FileNotFoundError:
        pass
    except (OSError, UnicodeDecodeError) as error:
        raise PortError(f"{path} is there already, and cannot be read: {error}") from None
