"""The API under /api/v1: JSON in SI units, with the names of the register tables."""

from servobus.server.web.api.routes import router
from servobus.server.web.rules import API as API_PREFIX

__all__ = ["API_PREFIX", "router"]
