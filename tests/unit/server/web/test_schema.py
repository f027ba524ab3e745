"""The API as its own description says: schemathesis sends what fits it and what does not, and no answer is a fault."""

import asyncio
import math
import threading
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("fastapi", reason="the web process needs fastapi: servobus[server]")
pytest.importorskip("schemathesis", reason="this test needs schemathesis, which the group dev brings")

import schemathesis
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st
from schemathesis.checks import CHECKS, load_all_checks
from schemathesis.core.result import Ok

import extent
from unit.server.web.rig import KEYS, LOCAL, ROBOT, SPEC
from unit.server.web.test_live import Served, served

EXAMPLES = 60 if extent.everything else 3
"""Of each operation, and of each kind: those that fit the description, and those that do not."""
HELD_BACK = {("DELETE", "/api/v1/buses/{bus}")}
"""Operations that are sent as they are drawn, for with real names they would take away what the others need."""


@contextmanager
def running() -> Iterator[tuple[Served, asyncio.AbstractEventLoop]]:
    """Serve in a thread, as schemathesis calls from outside of the loop."""
    loop, ready, over = asyncio.new_event_loop(), threading.Event(), asyncio.Event()
    made: list[Served] = []

    async def main() -> None:
        async with served() as one:
            made.append(one)
            ready.set()
            await over.wait()

    thread = threading.Thread(target=lambda: loop.run_until_complete(main()), daemon=True)
    thread.start()
    assert ready.wait(60)
    try:
        yield made[0], loop
    finally:
        loop.call_soon_threadsafe(over.set)
        thread.join(60)
        loop.close()


async def anew(made: Served, robot: str) -> None:
    """Put new servos in the place of those that were changed."""
    service = made.service
    service.jobs.break_off(None)
    for name in list(service.buses):
        await service.close_bus("server", name)
    bus = (await service.open_bus("server", "bench", SPEC)).bus
    for model, key in zip(("rx28", "rx28", "drs0602", "lx16a"), KEYS, strict=True):
        bus.attach(model, int(key.partition(":")[2].partition("@")[0]))
    await bus.torque_on()
    service.open_robot("arm", robot)


def test_no_request_makes_the_server_fail(tmp_path: Path) -> None:
    load_all_checks()
    names = ("not_a_server_error", "status_code_conformance", "content_type_conformance", "response_schema_conformance")
    checks = CHECKS.get_by_names(names)
    file = tmp_path / "arm.toml"
    file.write_text(ROBOT)
    with running() as (made, loop):
        description = made.web.api.openapi()
        schema = schemathesis.openapi.from_dict(description)
        schema.config.update(base_url=f"http://127.0.0.1:{made.port}")
        seen: Counter[int] = Counter()
        for found in schema.get_all_operations():
            assert isinstance(found, Ok)
            asyncio.run_coroutine_threadsafe(anew(made, str(file)), loop).result(60)
            check(made, found.ok(), checks, seen)
        assert {200, 202, 404, 409, 422} <= set(seen)  # it came further than the checks of what was sent


def check(made: Served, operation: Any, checks: Any, seen: Counter[int]) -> None:
    name = operation.method.upper(), operation.path
    modes = schemathesis.GenerationMode

    @settings(
        max_examples=EXAMPLES,
        deadline=None,
        database=None,
        derandomize=True,  # the same requests each time: what fails is due to what was changed
        phases=[Phase.generate],
        suppress_health_check=list(HealthCheck),
    )
    @given(st.data())
    def send(data: st.DataObject) -> None:
        mode = data.draw(st.sampled_from([modes.POSITIVE, modes.NEGATIVE]))
        case = data.draw(operation.as_strategy(generation_mode=mode))
        if name not in HELD_BACK:
            with_real_names(case, lambda names: data.draw(st.sampled_from(names)))
        if name[1].endswith(("/scan", "/doctor")) and isinstance(case.body, dict) and not case.body.get("ids"):
            case.body["ids"] = [1]  # all ids take a while, and on this clock nothing else has its turn meanwhile
        made.web.asgi._rates._buckets.clear()
        made.service.bus("bench").stopped_by, made.service.bus("bench")._stopped_at = "", -math.inf
        case.headers = {**(case.headers or {}), "Authorization": f"Bearer {LOCAL}"}
        case.headers.pop("Servobus-Connection", None)
        response = case.call(timeout=60)
        seen[response.status_code] += 1
        case.validate_response(response, checks=checks)

    send()


NAMES: dict[str, tuple[str, ...]] = {
    "bus": ("bench",),
    "servo": KEYS,
    "servos": KEYS,
    "goals": KEYS,
    "robot": ("arm",),
    "job": ("1", "2", "3"),
    "name": ("rx28", "lx16a", "drs0602"),
    "names": ("led", "goal_position", "present_load", "alarm_led", "output_limit"),
    "values": ("led", "goal_position", "max_position", "alarm_led", "output_limit", "torque_enable", "position_gain"),
    "model": ("rx28", "lx16a", "drs0602", "lx224"),
    "pose": ("home",),
}
"""Names that mean something here, by the key under which one stands: by chance hardly any would be met."""


def with_real_names(case: Any, pick: Callable[[Sequence[str]], str]) -> None:
    """Put names in the place of those that were drawn."""
    for part in (case.path_parameters, case.query, case.body):
        if not isinstance(part, dict):
            continue
        for key, names in NAMES.items():
            match part.get(key):
                case str():
                    part[key] = pick(names)
                case list() as several:
                    part[key] = [pick(names) for _ in several]
                case dict() as by_name:
                    part[key] = {pick(names): value for value in by_name.values()}
