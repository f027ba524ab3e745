"""Routes: stopping, which comes before everything, and moving."""

from fastapi import APIRouter

from servobus.server.web.api import shapes
from servobus.server.web.api.answers import By, Json, LoggedIn, Svc, gives
from servobus.server.web.api.places import BusName, ServoName
from servobus.server.web.served_bus import Actor

stopping = APIRouter(tags=["stop"])
router = APIRouter(tags=["motion"])


@stopping.post("/stop", responses=gives(dict[str, dict[str, str]], "Bus -> servo -> what was done."))
async def stop(service: Svc, login: LoggedIn) -> Json:
    """Stop all servos of all buses. For everybody who has logged in; needs no body, no lease and no patience.

    Nothing moves any more for 5 s, and until somebody resumes.
    """
    return Json(await service.stop(Actor(login.name)))


@stopping.post("/buses/{bus}/stop", responses=gives(dict[str, str], "Servo -> what was done."))
async def stop_bus(service: Svc, login: LoggedIn, bus: BusName, body: shapes.StopBody | None = None) -> Json:
    """Stop the servos of one bus, or some of them. As `POST /stop`."""
    return Json(await service.bus(bus).stop(Actor(login.name), None if body is None else body.servos))


@router.post("/buses/{bus}/resume", responses=gives(shapes.Bus, "The bus."))
async def resume(service: Svc, by: By, bus: BusName) -> Json:
    """Let servos be moved again after a stop. Moves nothing."""
    await service.bus(bus).resume(by)
    return Json(service.bus(bus).entry())


@router.post("/buses/{bus}/take", responses=gives(list[shapes.Servo], "The servos."))
async def take(service: Svc, by: By, bus: BusName, body: shapes.TakeBody) -> Json:
    """Hold servos that another client may hold: they are made safe first. Only over a connection that is watched."""
    served = service.bus(bus)
    await served.take_over(by, body.servos)
    return Json([served.servo_entry(servo) for servo in served.servos(body.servos)])


@router.post("/buses/{bus}/moves", status_code=202, responses=gives(shapes.Job, "They move.", 202))
async def move(service: Svc, by: By, bus: BusName, body: shapes.MoveBody) -> Json:
    """Start a move of several servos that start together and arrive together: a job. Cancelling it stops them.

    Their torque must be on already.
    """
    job = await service.bus(bus).move(by, body.goals, time=body.time, speed=body.speed)
    return Json(job.entry(), status_code=202)


@router.post("/buses/{bus}/torque", responses=gives(list[shapes.Servo], "The servos."))
async def torque(service: Svc, by: By, bus: BusName, body: shapes.TorqueBody) -> Json:
    """Switch the torque on, each servo where it stands, or off: then the shafts turn freely."""
    served = service.bus(bus)
    await served.torque(by, body.servos, on=body.on, to_limit=body.to_limit)
    return Json([served.servo_entry(servo) for servo in served.servos(body.servos)])


@router.post("/buses/{bus}/servos/{servo}/turn", responses=gives(shapes.Servo, "It turns."))
async def turn(service: Svc, by: By, bus: BusName, servo: ServoName, body: shapes.TurnBody) -> Json:
    """Turn without end. Only over a connection that is watched: see the header Servobus-Connection."""
    served = service.bus(bus)
    await served.turn(by, servo, speed=body.speed, output=body.output, current=body.current)
    return Json(served.servo_entry(served.servo(servo)))


@router.post("/buses/{bus}/servos/{servo}/position_mode", responses=gives(shapes.Servo, "It holds its position."))
async def position_mode(service: Svc, by: By, bus: BusName, servo: ServoName, body: shapes.PositionModeBody) -> Json:
    """Come back from endless turn and hold the present position."""
    served = service.bus(bus)
    limits = None if body.limits is None else (body.limits[0], body.limits[1])
    await served.position_mode(by, servo, limits, body.multi_turn)
    return Json(served.servo_entry(served.servo(servo)))


@router.post("/buses/{bus}/servos/{servo}/rearm", responses=gives(shapes.Servo, "Its torque is on."))
async def rearm(service: Svc, by: By, bus: BusName, servo: ServoName) -> Json:
    """Switch the torque on again after the servo has switched it off by itself. Nothing moves."""
    served = service.bus(bus)
    await served.rearm(by, servo)
    return Json(served.servo_entry(served.servo(servo)))


@router.post("/buses/{bus}/servos/{servo}/led", responses=gives(shapes.Ok, "The light is set."))
async def led(service: Svc, by: By, bus: BusName, servo: ServoName, body: shapes.LedBody) -> Json:
    """Set the light of a servo."""
    await service.bus(bus).led(by, servo, body.colour)
    return Json({"ok": True})
