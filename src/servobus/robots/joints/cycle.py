"""A control cycle of a robot: goals out and readings in by joint, on all ports side by side.

    cycle = arm.cycle()
    for tick in cycle.every(0.01):
        seen = cycle.run(shoulder=0.2 * math.sin(tick.time))
        print(seen["shoulder"]["present_position"], seen.lost)

Each port has a `Cycle` of its own, see servobus.bus.cycle. Goals are checked against the limits of the joints before
any is sent. Joints that do not answer are `lost` in the result, and the others go on.
"""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from servobus.bus.cycle import Cycle, Result
from servobus.bus.rate import Rate
from servobus.bus.servo import Servo
from servobus.core.exchange import Now, Procedure
from servobus.core.operation import Awaiting, Blocking, Priority, bus_method, urgent
from servobus.core.registers import Register
from servobus.errors import ServobusError
from servobus.robots.joints import jobs
from servobus.robots.joints.joint import Joint, check_meant
from servobus.robots.ports import AsyncOnPorts, OnPorts, Ports
from servobus.robots.steps import RobotJob, each
from servobus.robots.values import ByJoint, named_angles


class RobotResult(ByJoint[dict[str, Any]]):
    """What a cycle read: joint -> name of the register -> value, in joint space; `lost` tells of the others.

    times  port -> moment at which its readings were complete, s since the robot was opened
    ports  port -> what its own cycle gave, by servo
    """

    def __init__(
        self,
        values: Mapping[str, dict[str, Any]],
        lost: Mapping[str, ServobusError],
        times: Mapping[str, float],
        ports: Mapping[str, Result],
    ) -> None:
        super().__init__(values, lost)
        self.times, self.ports = dict(times), dict(ports)

    @property
    def positions(self) -> ByJoint[float]:
        """The angles alone, rad."""
        return ByJoint({name: seen["present_position"] for name, seen in self.items()}, self.lost)

    @property
    def diagnosis(self) -> str:
        """Say what the lost servos of each port have in common; empty if none is lost."""
        said = {port: result.diagnosis for port, result in self.ports.items()}
        return "; ".join(f"port {port}: {text}" for port, text in said.items() if text)


class RobotCycle:
    """A control cycle of joints, prepared; see the head of this module.

    ports   the ports of the robot
    joints  those that are read, and that may be given goals
    read    registers that all their servos have, or their names
    time    s that the way to each goal takes, where the family has such a time; 0 is as fast as possible
    """

    def __init__(
        self,
        ports: Ports[Any],
        joints: Sequence[Joint],
        read: Iterable[Register[Any] | str] | Register[Any] | str,
        time: float,
    ) -> None:
        self._ports, self.joints = ports, list(joints)
        self._names = [joint.name for joint in joints]
        self._by_name = {joint.name: joint for joint in joints}
        self.cycles = {
            port: Cycle(ports.buses[port].transport, [part.servo for part in there], read, ("goal_position",), time)
            for port, there in jobs.on_each_port(joints, list).items()
        }
        """The cycle of each port."""

    def every(self, period: float) -> Rate:
        """Give turns at a fixed rate, `period` in s: `for tick in cycle.every(0.01)`; see `Rate`."""
        assert isinstance(self, Blocking | Awaiting)
        return Rate(self, self._ports.now, period)

    @bus_method
    @urgent(Priority.MOTION)
    def run(self, goals: Any = None, /, **angles: float) -> RobotJob[RobotResult]:
        """Send goals, name -> angle in rad or keywords, and read all joints.

        Raises BadValue outside the limits of a joint, before anything is sent; Disagreement where two servos on one
        axis stand too far apart; and what `Cycle.run` raises of one port, after the others had their turn.
        """
        return self.turn(named_angles(goals, self._names, angles))

    def turn(self, goals: Mapping[str, float]) -> RobotJob[RobotResult]:
        """Build the job of one cycle; see `run`."""
        servo_goals: dict[str, dict[Servo, float]] = {}
        for name, angle in goals.items():
            joint = self._by_name[name]
            check_meant([joint])
            allowed = joint.check(angle)
            for part in joint.parts:
                servo_goals.setdefault(part.port, {})[part.servo] = part.axis.to_servo(allowed)
        outcomes = yield from each(
            {port: _stamped(cycle, servo_goals.get(port)) for port, cycle in self.cycles.items()}
        )
        results: dict[str, Result] = {}
        times: dict[str, float] = {}
        for port, outcome in outcomes.items():
            if isinstance(outcome, ServobusError):
                raise outcome
            results[port], moment = outcome
            times[port] = self._ports.at(port, moment)
        return self._result(results, times)

    def _result(self, results: Mapping[str, Result], times: Mapping[str, float]) -> RobotResult:
        values: dict[str, dict[str, Any]] = {}
        lost: dict[str, ServobusError] = {}
        came = {port: result.by_servo for port, result in results.items()}
        for joint in self.joints:
            seen: list[dict[str, Any]] = []
            for part in joint.parts:
                one = came[part.port].get(part.servo)
                if one is None:
                    lost.setdefault(joint.name, results[part.port].lost[part.servo])
                else:
                    seen.append(one)
            if joint.mistaken:
                lost[joint.name] = joint.mismatch()
            if joint.name not in lost:
                values[joint.name] = {name: jobs.joined(joint, name, [one[name] for one in seen]) for name in seen[0]}
        return RobotResult(values, lost, times, results)

    def plan(self) -> str:
        """Say port by port and packet by packet what a cycle sends, and how long that takes on the wire."""
        return "\n".join(f"port {port}: {cycle.plan()}" for port, cycle in self.cycles.items())

    __str__ = plan


def _stamped(cycle: Cycle, goals: Mapping[Servo, float] | None) -> Procedure[tuple[Result, float]]:
    """Run the cycle of a port, and give the moment of its end by the clock of the port."""
    result: Result = yield from cycle.run(goals)
    moment: float = yield Now()
    return result, moment


class BlockingRobotCycle(OnPorts, RobotCycle):
    """A cycle of a blocking robot."""


class AsyncRobotCycle(AsyncOnPorts, RobotCycle):
    """A cycle of an asynchronous robot: `await cycle.run(...)`, `async for tick in cycle.every(...)`."""
