"""The web process around virtual servos, without a network: an application, and clients of each role."""

from collections.abc import AsyncIterator, Mapping
from contextlib import asynccontextmanager
from typing import Any

import httpx

from servobus.server.web.app import WebApplication
from servobus.server.web.auth import Role
from servobus.server.web.config import WebConfig

REAL = "virtual:rx28@1,2,drs0602@219,lx16a@3"
SPEC = f"{REAL}?clock=virtual"
"""The same servos by the clock of the computer, and by one on which nobody waits."""
BASE = "http://127.0.0.1:7380"
START, LOCAL = "start-token-of-the-test", "local-token-of-the-test"
KEYS = ("dynamixel:1@57600", "dynamixel:2@57600", "herkulex:219@115200", "lewansoul:3@115200")

ROBOT = """
[robot]
format = 1
name = "arm"

[port.bench]
path = "virtual:rx28@1,2"

[joint.shoulder]
port = "bench"
model = "rx28"
id = 1
zero = "150deg"
limits = ["-60deg", "60deg"]

[joint.shoulder.registers]
max_torque = "50%"
led = true

[joint.elbow]
port = "bench"
model = "rx28"
id = 2
zero = "150deg"

[pose.home]
shoulder = "10deg"
elbow = "20deg"
"""
"""A robot whose port is the bus of the rig."""


class Rig:
    """An application that is open, with its servos attached."""

    def __init__(self, config: WebConfig) -> None:
        self.web = WebApplication(config)
        self.service, self.authority = self.web.service, self.web.authority
        self.tokens = {role: self.authority.make_token(f"{role} of the test", role) for role in Role}

    def client(self, role: Role | None = Role.ADMIN, **headers: str) -> httpx.AsyncClient:
        """Give a client with the token of a role, or with none."""
        bearer = {} if role is None else {"authorization": f"Bearer {self.tokens[role]}"}
        transport = httpx.ASGITransport(self.web.asgi)
        return httpx.AsyncClient(transport=transport, base_url=BASE, headers={**bearer, **headers})


@asynccontextmanager
async def rig(**changes: Any) -> AsyncIterator[Rig]:
    """Open an application on virtual servos; `changes` are those of its configuration."""
    config = WebConfig(**{"start_token": START, "local_token": LOCAL, "buses": {"bench": SPEC}, **changes})
    made = Rig(config)
    async with made.web:
        if "bench" in made.service.buses:
            bus = made.service.bus("bench").bus
            for key in KEYS:
                family, _, rest = key.partition(":")
                model = {"dynamixel": "rx28", "herkulex": "drs0602", "lewansoul": "lx16a"}[family]
                bus.attach(model, int(rest.partition("@")[0]))
        yield made


def error_of(answer: httpx.Response) -> Mapping[str, Any]:
    """Give the error that an answer tells of, which has the shape that all errors have."""
    body = answer.json()
    assert set(body) == {"error"}
    error: Mapping[str, Any] = body["error"]
    assert {"type", "message"} <= set(error) <= {"type", "message", "remedy", "detail"}
    return error
