"""The web process as one ASGI application: the guard around the API, and around pages where they are mounted."""

from types import TracebackType
from typing import Self

from fastapi import FastAPI

import servobus
from servobus.server.web.api import API_PREFIX, router
from servobus.server.web.api.answers import Context, handle_errors
from servobus.server.web.auth import Authority
from servobus.server.web.config import WebConfig
from servobus.server.web.guard import Guard
from servobus.server.web.owner_link import OwnerLink
from servobus.server.web.service import Service

ABOUT = """Servos on serial buses: read, set up, move and watch them.

Values are in SI units (rad, rad/s, s, V; temperatures in °C, shares as ratios), with the names of the register tables.
Programs send `Authorization: Bearer TOKEN`. A status of 500 and above means that the server has a fault, and nothing
else: a servo that does not answer is 424.
"""


class WebApplication:
    """The application, and what it works on. It is opened by `async with`, in the loop that serves it.

    api      the inner application; pages are mounted on it, after the API
    asgi     what is served: the guard around it
    """

    def __init__(self, config: WebConfig, service: Service | None = None, authority: Authority | None = None) -> None:
        self.config = config
        self.service = service or Service(audit=config.audit, recordings=config.recordings)
        self.authority = authority or Authority(
            start_token=config.start_token,
            local_token=config.local_token,
            password=config.password,
            tokens_file=config.tokens_file,
        )
        self.context = Context(config, self.authority, self.service)
        self.api = FastAPI(
            title="servobus",
            version=servobus.__version__,
            description=ABOUT,
            docs_url=None,  # their scripts come from elsewhere
            redoc_url=None,
            openapi_url=f"{API_PREFIX}/openapi.json",
            redirect_slashes=False,
        )
        self.api.state.context = self.context
        self.api.include_router(router)
        handle_errors(self.api)
        self.listens(config.port)

    def listens(self, port: int) -> None:
        """Take note of the port, which the system may have chosen."""
        config = self.config
        self.context.port = port
        host = f"[{config.host}]" if ":" in config.host else config.host
        name = config.names[0] if config.names and not config.loopback else host
        self.context.base = f"{config.scheme}://{name}:{port}"
        self.asgi = Guard(
            self.api,
            self.authority,
            is_ours=lambda host: config.goes_by(host, port),
            scheme=config.scheme,
            cookie=self.context.cookie,
            local=config.loopback,
            read_only=config.read_only,
        )

    async def __aenter__(self) -> Self:
        """Open all buses and robots. Raises ServobusError, with nothing open, if one of them cannot be."""
        try:
            if self.config.owner is not None:
                await self.service.join(OwnerLink(*self.config.owner, self.config.owner_token))
            for name, port in self.config.buses.items():
                await self.service.open_bus("server", name, port)
            for name, file in self.config.robots.items():
                self.service.open_robot(name, file)
        except BaseException:
            await self.service.close()
            raise
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        await self.service.close()
