"""A process that shares a port: for programs on pseudo terminals of their own, and for servobus programs.

    python tests/clients/sharing.py PORT FOLDER LINK...

It says `ready ADDRESS` when all can come, and ends when its input does.
"""

import asyncio
import sys
from contextlib import AsyncExitStack
from pathlib import Path

from servobus.server.ports import foreign
from servobus.server.ports.owner import PortOwner

TOKEN = "the token of the tests"


foreign.ANSWERED_WITHIN = 0.3  # on a busy computer answers may be late, and the programs of the tests wait longer


async def share(port: str, folder: Path, links: list[str]) -> None:
    owner = PortOwner({TOKEN: "operator"}, boxes=folder)
    bus = owner.open_bus("arm", port).bus
    bus.transport.latency = 0.1  # on a busy computer the process of the servos may be late
    server = await owner.service.listen("127.0.0.1", 0)
    try:
        async with AsyncExitStack() as stack:
            for link in links:
                await stack.enter_async_context(foreign.ForeignPty(bus, "arm", owner.control, Path(link)))
            print(f"ready servobus://127.0.0.1:{server.sockets[0].getsockname()[1]}/arm", flush=True)
            await asyncio.to_thread(sys.stdin.read)
    finally:
        server.close()
        await owner.close()


if __name__ == "__main__":
    asyncio.run(share(sys.argv[1], Path(sys.argv[2]), sys.argv[3:]))
