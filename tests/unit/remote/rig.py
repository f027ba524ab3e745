"""Servos whose truth is known, behind a server: the rig of the fault tests, with a client as its bus."""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from faults.rig import FaultRig
from unit.lossy import ASYNC, SYNC
from unit.remote.hosted import Hosted


class RemoteRig(FaultRig):
    """A `FaultRig` whose bus goes through a server. Its servos are on a virtual clock, which the server lets go on."""

    def __init__(self, hosted: Hosted, key: str, driver: str = SYNC, **how: Any) -> None:
        self._hosted = hosted
        super().__init__(key, driver, **how)

    def _bus(self, driver: str, echo: bool | None) -> Any:
        name = self._hosted.add(self.port, echo=echo)
        return self._hosted.async_bus(name) if driver == ASYNC else self._hosted.bus(name)


@contextmanager
def remote_rig(hosted: Hosted, key: str, driver: str = SYNC, **how: Any) -> Iterator[RemoteRig]:
    """Make a rig, and close its bus in the end."""
    rig = RemoteRig(hosted, key, driver, **how)
    try:
        yield rig
    finally:
        rig.bus.close()
