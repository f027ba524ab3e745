"""Routes: robots, their joints by name, and their settings."""

from fastapi import APIRouter

from servobus.errors import BadValue
from servobus.server.web.api import shapes
from servobus.server.web.api.answers import By, Json, Svc, gives
from servobus.server.web.api.places import RobotName

router = APIRouter(tags=["robots"])


@router.get("/robots", responses=gives(list[shapes.Robot], "The robots."))
async def robots(service: Svc) -> Json:
    """List the robots: joints, groups, poses and motions of their files."""
    return Json([robot.entry() for robot in service.robots.values()])


@router.get("/robots/{robot}", responses=gives(shapes.Robot, "The robot."))
async def robot(service: Svc, robot: RobotName) -> Json:
    """Give one robot."""
    return Json(service.robot(robot).entry())


@router.get("/robots/{robot}/positions", responses=gives(shapes.Positions, "Joint -> rad."))
async def positions(service: Svc, robot: RobotName) -> Json:
    """Read the angles of all joints."""
    return Json(await service.robot(robot).positions())


@router.get("/robots/{robot}/check", responses=gives(dict[str, object], "What is not as the file says."))
async def check(service: Svc, robot: RobotName) -> Json:
    """Compare who answers with the file: missing, strangers, wrong models, swapped ones. Moves nothing."""
    return Json(await service.robot(robot).check())


@router.get("/robots/{robot}/plan", responses=gives(shapes.Plan, "What would be written."))
async def plan(service: Svc, robot: RobotName) -> Json:
    """Compare the settings of the servos with the file. Moves nothing, writes nothing."""
    return Json(await service.robot(robot).plan())


@router.post("/robots/{robot}/apply", responses=gives(dict[str, object], "What was written."))
async def apply(service: Svc, by: By, robot: RobotName, body: shapes.ApplyBody) -> Json:
    """Write what differs from the file, and read it back. What was there before is kept; `undo` brings it back."""
    return Json(await service.robot(robot).apply(by, torque_off=body.torque_off, offsets=body.offsets))


@router.post("/robots/{robot}/undo", responses=gives(dict[str, object], "What was brought back."))
async def undo(service: Svc, by: By, robot: RobotName, body: shapes.UndoBody) -> Json:
    """Bring back what the servos held before the last `apply`. The same again goes back further."""
    return Json(await service.robot(robot).undo(by, torque_off=body.torque_off))


@router.post("/robots/{robot}/torque", responses=gives(shapes.Ok, "Done."))
async def robot_torque(service: Svc, by: By, robot: RobotName, body: shapes.SwitchBody) -> Json:
    """Switch the torque of all joints on, each where it stands, or off: then an arm may fall."""
    await service.robot(robot).torque(by, on=body.on)
    return Json({"ok": True})


@router.post("/robots/{robot}/moves", status_code=202, responses=gives(dict[str, float], "They move.", 202))
async def robot_move(service: Svc, by: By, robot: RobotName, body: shapes.JointMoveBody) -> Json:
    """Start a move of joints, to angles or to a pose of the file; gives its duration in s."""
    served = service.robot(robot)
    if (body.goals is None) is (body.pose is None):
        raise BadValue("give one of both: goals, or the name of a pose")
    goals = body.goals if body.goals is not None else served.robot.pose(body.pose or "")
    return Json(await served.move(by, goals, time=body.time, speed=body.speed), status_code=202)
