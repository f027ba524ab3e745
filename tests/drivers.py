"""What the tests of both drivers share."""

import asyncio
import inspect
from typing import Any


def result_of(job: Any) -> Any:
    """Give what a driver gives, whichever it is: the asynchronous one is awaited."""
    if not inspect.isawaitable(job):
        return job

    async def wait() -> Any:
        return await job

    return asyncio.run(wait())
