"""Routes: the server itself, jobs, events, the audit log, recordings, models."""

import asyncio
from typing import Annotated

from fastapi import APIRouter, Path, Query
from starlette.responses import FileResponse

import servobus
from servobus.core.present import si_register_entry
from servobus.families import registry
from servobus.families.present import model_entry
from servobus.server.web.api import shapes
from servobus.server.web.api.answers import By, Ctx, Json, LoggedIn, Svc, gives

router = APIRouter(tags=["server"])
JobId = Annotated[str, Path(max_length=20)]


@router.get("/health", responses=gives(shapes.Health, "The server is there."))
async def health() -> Json:
    """Tell whether the server is there. The only question that needs no login."""
    return Json({"ok": True})


@router.get("/server", responses=gives(shapes.Server, "The server and who asks."))
async def server(context: Ctx, login: LoggedIn) -> Json:
    """Tell what this server is, and who you are to it."""
    config = context.config
    return Json(
        {
            "version": servobus.__version__,
            "time": asyncio.get_running_loop().time(),
            "warning": config.warning or None,
            "read_only": config.read_only,
            "you": login.entry(),
            "clients": len(context.service.events),
        }
    )


@router.get("/jobs", responses=gives(list[shapes.Job], "The jobs, the newest first."))
async def jobs(service: Svc) -> Json:
    """List jobs: scans, examinations and moves, those that ended lately too."""
    return Json(service.jobs.entries())


@router.get("/jobs/{job}", responses=gives(shapes.Job, "The job."))
async def job(service: Svc, job: JobId) -> Json:
    """Tell how far a job is, what it has found so far, and what came of it."""
    return Json(service.jobs[job].entry())


@router.delete("/jobs/{job}", responses=gives(shapes.Job, "The job, which has ended."))
async def cancel_job(service: Svc, by: By, job: JobId) -> Json:
    """Break a job off; servos of a move are stopped. One that has ended stays as it is."""
    service.audit.note(by.name, "cancel job", service.jobs[job].bus, "", {"job": job})
    return Json((await service.jobs.cancel(job)).entry())


@router.get("/events", responses=gives(list[dict[str, object]], "Events, the oldest first."))
async def events(service: Svc, after: Annotated[int, Query(ge=0, le=2**53)] = 0) -> Json:
    """Give the last events with a higher number than `after`; the live connection tells them as they come."""
    return Json(service.events.past(after))


@router.get("/audit", responses=gives(list[dict[str, object]], "Entries, the newest first."))
async def audit(service: Svc, count: Annotated[int, Query(ge=1, le=1000)] = 100) -> Json:
    """Tell who changed what, and what came of it."""
    return Json(service.audit.latest(count))


@router.get("/recordings", responses=gives(list[shapes.Recording], "The recordings, the newest first."))
async def recordings(service: Svc) -> Json:
    """List the recordings that are kept."""
    return Json(service.recordings())


@router.get(
    "/recordings/{name}",
    response_class=FileResponse,
    responses={200: {"content": {"application/octet-stream": {}}, "description": "The file."}},
)
async def recording(service: Svc, name: Annotated[str, Path(max_length=200)]) -> FileResponse:
    """Give a recording as a file."""
    return FileResponse(service.recording(name), media_type="application/octet-stream", filename=name)


@router.get("/models", responses=gives(list[dict[str, object]], "The makers' data of each."))
async def models(service: Svc) -> Json:
    """List the models that are known, with their makers' data."""
    return Json(service.models())


@router.get("/models/{name}", responses=gives(shapes.ModelTable, "The table."))
async def model(name: Annotated[str, Path(max_length=60)]) -> Json:
    """Give the table of a model: each register with its unit, limits, default and meaning."""
    found = registry.model(name)
    rows = [si_register_entry(row) for row in found.registers.values() if row.readable]
    return Json({"sheet": model_entry(found), "registers": rows})
