"""Routes: buses, the servos on them, scans and examinations."""

from fastapi import APIRouter

from servobus.server.web.api import shapes
from servobus.server.web.api.answers import By, Json, Svc, gives
from servobus.server.web.api.places import BusName, ServoName

router = APIRouter(tags=["buses"])


@router.get("/buses", responses=gives(list[shapes.Bus], "The buses."))
async def buses(service: Svc) -> Json:
    """List the buses."""
    return Json([bus.entry() for bus in service.buses.values()])


@router.post("/buses", status_code=201, responses=gives(shapes.Bus, "The bus.", 201))
async def open_bus(service: Svc, by: By, body: shapes.OpenBody) -> Json:
    """Open a port. Asks nothing, moves nothing."""
    return Json((await service.open_bus(by.name, body.name, body.port)).entry(), status_code=201)


@router.get("/buses/{bus}", responses=gives(shapes.Bus, "The bus."))
async def bus(service: Svc, bus: BusName) -> Json:
    """Give one bus."""
    return Json(service.bus(bus).entry())


@router.delete("/buses/{bus}", responses=gives(shapes.Ok, "It is closed."))
async def close_bus(service: Svc, by: By, bus: BusName) -> Json:
    """Close a port. What is driven there is made safe first."""
    await service.close_bus(by.name, bus)
    return Json({"ok": True})


@router.post("/buses/{bus}/scan", status_code=202, responses=gives(shapes.Job, "The job has begun.", 202))
async def scan(service: Svc, by: By, bus: BusName, body: shapes.ScanBody) -> Json:
    """Look for servos: a job that tells what it finds as it goes. Moves nothing, changes nothing."""
    job = service.scan(by, bus, families=body.families, bauds=body.bauds, ids=body.ids)
    return Json(job.entry(), status_code=202)


@router.post("/buses/{bus}/doctor", status_code=202, responses=gives(shapes.Job, "The job has begun.", 202))
async def doctor(service: Svc, by: By, bus: BusName, body: shapes.DoctorBody) -> Json:
    """Find out what is wrong with a port and its servos: a job. Moves nothing, changes nothing."""
    return Json(service.doctor(by, bus, ids=body.ids, reads=body.reads).entry(), status_code=202)


@router.get("/buses/{bus}/servos", responses=gives(list[shapes.Servo], "The known servos, as they were seen last."))
async def servos(service: Svc, bus: BusName) -> Json:
    """List the servos that are known on a bus."""
    return Json(service.bus(bus).servo_entries())


@router.post("/buses/{bus}/servos", status_code=201, responses=gives(shapes.Servo, "The servo.", 201))
async def attach(service: Svc, by: By, bus: BusName, body: shapes.AttachBody) -> Json:
    """Name a servo that is there, without asking it anything."""
    return Json(service.bus(bus).attach(by, body.model, body.id, body.baud), status_code=201)


@router.get("/buses/{bus}/servos/{servo}", responses=gives(shapes.Servo, "The servo, as it was seen last."))
async def servo(service: Svc, bus: BusName, servo: ServoName) -> Json:
    """Give one servo; nothing is asked of it."""
    served = service.bus(bus)
    return Json(served.servo_entry(served.servo(servo)))


@router.get("/buses/{bus}/servos/{servo}/state", responses=gives(shapes.Servo, "The servo, as it is now."))
async def look(service: Svc, bus: BusName, servo: ServoName) -> Json:
    """Look at a servo: position, supply, temperature, torque, alarms."""
    return Json(await service.bus(bus).look(servo))


@router.delete("/buses/{bus}/servos/{servo}", responses=gives(shapes.Ok, "It is known no more."))
async def forget(service: Svc, by: By, bus: BusName, servo: ServoName) -> Json:
    """Know a servo no more. Refused while it is driven."""
    service.bus(bus).forget(by, servo)
    return Json({"ok": True})
