"""Routes: registers, and the settings that survive power-off."""

from typing import Annotated

from fastapi import APIRouter, Query

from servobus.errors import BadValue
from servobus.server.web.api import shapes
from servobus.server.web.api.answers import By, Json, Svc, gives
from servobus.server.web.api.places import BusName, ServoName

router = APIRouter(prefix="/buses/{bus}/servos/{servo}", tags=["registers"])


@router.get("/registers", responses=gives(list[shapes.RegisterNow], "The rows, in the order of the table."))
async def registers(service: Svc, bus: BusName, servo: ServoName) -> Json:
    """Read the whole table of a servo: each register with its value, unit, limits, default and meaning."""
    return Json(await service.bus(bus).registers(servo))


@router.get("/values", responses=gives(dict[str, shapes.Value], "Name -> value."))
async def read(
    service: Svc,
    bus: BusName,
    servo: ServoName,
    names: Annotated[list[str], Query(min_length=1, max_length=100, description="names or aliases of registers")],
    stored: Annotated[bool, Query(description="whether what survives power-off is read")] = False,
) -> Json:
    """Read some registers."""
    return Json(await service.bus(bus).read(servo, names, stored=stored))


@router.post("/values", responses=gives(shapes.WriteResult, "Old and new values, read back."))
async def write(service: Svc, by: By, bus: BusName, servo: ServoName, body: shapes.WriteBody) -> Json:
    """Write registers and read them back. Nothing is written unless all names and values are right.

    What moves the servo obeys the rules of moves. Id and speed are changed by `identity` alone.
    """
    return Json(await service.bus(bus).write(by, servo, _plain(body), save=body.save))


@router.post("/values/preview", responses=gives(shapes.Preview, "What would change."))
async def preview(service: Svc, bus: BusName, servo: ServoName, body: shapes.WriteBody) -> Json:
    """Say what a write would change, and how many values of it would go to the EEPROM. Writes nothing."""
    return Json(await service.bus(bus).preview(servo, _plain(body), save=body.save))


@router.get("/backup", responses=gives(shapes.SavedBackup, "The settings."))
async def backup(service: Svc, bus: BusName, servo: ServoName) -> Json:
    """Read all settings that survive power-off: as a file, and value by value."""
    return Json(await service.bus(bus).backup(servo))


@router.post("/restore/preview", responses=gives(shapes.RestorePreview, "What would change."))
async def preview_restore(service: Svc, bus: BusName, servo: ServoName, body: shapes.BackupBody) -> Json:
    """Say what restoring a backup would change, and how many values go to the EEPROM. Writes nothing."""
    return Json(await service.bus(bus).preview_restore(servo, body.text))


@router.post("/restore", responses=gives(shapes.Names, "The registers that were written."))
async def restore(service: Svc, by: By, bus: BusName, servo: ServoName, body: shapes.RestoreBody) -> Json:
    """Write the settings of a backup that differ. Moves nothing; id and speed stay as they are."""
    return Json({"names": await service.bus(bus).restore(by, servo, body.text, torque_off=body.torque_off)})


@router.post("/identity", responses=gives(shapes.Servo, "The servo under its new key."))
async def identity(service: Svc, by: By, bus: BusName, servo: ServoName, body: shapes.IdentityBody) -> Json:
    """Give a servo another id, another speed, or both. Refused where some servo has it already."""
    if body.id is None and body.baud is None:
        raise BadValue("give an id, a speed, or both")
    return Json(await service.bus(bus).change_identity(by, servo, body.id, body.baud))


@router.post("/reset", responses=gives(shapes.Servo, "The servo under its new key."))
async def reset(service: Svc, by: By, bus: BusName, servo: ServoName, body: shapes.ResetBody) -> Json:
    """Restore factory settings, less what is kept."""
    return Json(await service.bus(bus).reset(by, servo, body.keep))


@router.post("/reboot", responses=gives(shapes.Ok, "It has restarted."))
async def reboot(service: Svc, by: By, bus: BusName, servo: ServoName) -> Json:
    """Restart a servo: its torque goes off, and its RAM gets the start values."""
    await service.bus(bus).reboot(by, servo)
    return Json({"ok": True})


def _plain(body: shapes.WriteBody) -> dict[str, object]:
    """Give the values as JSON has them."""
    return {
        name: value.model_dump() if isinstance(value, shapes.RawValue) else value for name, value in body.values.items()
    }
