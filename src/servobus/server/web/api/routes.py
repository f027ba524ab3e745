"""All routes of the API. Those that stop come first."""

from fastapi import APIRouter

from servobus.server.web.api import access, buses, general, live, motion, registers, robots
from servobus.server.web.api.answers import ERRORS
from servobus.server.web.rules import API

router = APIRouter(prefix=API, responses=ERRORS)
for part in (
    motion.stopping,
    general.router,
    access.router,
    buses.router,
    registers.router,
    motion.router,
    robots.router,
):
    router.include_router(part)
router.include_router(live.router)
