"""Programs that hang, and servos that get hot or stall (F21, F25)."""

import asyncio
import time
from inspect import isawaitable
from typing import Any

import pytest

import servobus
from faults.rig import FaultRig
from samples import hottest, minds_overload, models_that, sample_models
from servobus import MODELS, Stopped, deg
from servobus.safety.overload import Level
from servobus.virtual.physics.motor import Load
from unit.lossy import ASYNC, DRIVERS

PATIENCE = 30.0
"""s; a limit against hanging."""


@DRIVERS
@sample_models
def test_F21_a_program_that_hangs_is_made_safe_once(key: str, driver: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Nothing is heard of the program for the time-out, and the clock on the wall jumps back: the joint is made safe by
    a thread of its own, motion raises Stopped until somebody says go on, and reading goes on."""

    async def main() -> None:
        async def got(done: Any) -> Any:
            return await done if isawaitable(done) else done

        opener = servobus.open_async if driver == ASYNC else servobus.open
        bus: Any = opener(f"virtual:{key}@1?clock=real")
        servo, real = bus.attach(MODELS[key], 1), bus.transport.servos[0]
        await got(servo.torque_on())
        with bus.watch(timeout=0.05, action="free") as watch:
            monkeypatch.setattr(time, "time", lambda: 0.0)
            assert watch.wait(PATIENCE)  # blocks everything here, as a program does that is stuck
            assert watch.tripped
            assert not real.torque
            with pytest.raises(Stopped):
                await got(servo.torque_on())
            await got(servo.read(MODELS[key].register("present_position")))
            watch.reset()
            await got(servo.torque_on())
        bus.close()

    asyncio.run(main())


@DRIVERS
@sample_models
def test_F25_heat_is_warned_of_then_weakens_then_stops(key: str, driver: str) -> None:
    """A servo that warms up to its limit from the factory: told 10 °C before its limit, weakened 5 °C
    before it, made safe at it, and back in the same steps."""
    rig = FaultRig(key, driver, ids="1")
    limit = hottest(rig.model)
    rig.do(lambda bus: bus[1].torque_on())
    levels = []
    for celsius in (25, limit - 9, limit - 4, limit, limit - 8, limit - 14, 25):
        rig.real().temperature = celsius
        rig.port.sleep(0.1)
        levels.append(rig.do(lambda bus: bus.protect())[1])
        if levels[-1] is Level.SAFE:
            with pytest.raises(Stopped):
                rig.do(lambda bus: bus[1].start_move(rig.real().position + 5 * deg, time=1.0))
    assert levels == [Level.OK, Level.WARN, Level.DERATE, Level.SAFE, Level.WARN, Level.OK, Level.OK]


@DRIVERS
@models_that(minds_overload)
def test_F25_a_blocked_servo_is_made_safe_before_it_burns(key: str, driver: str) -> None:
    """A locked rotor: within a second of pushing without motion it is SAFE, and motion raises Stopped."""
    rig = FaultRig(key, driver, ids="1")
    start = rig.real().position
    rig.do(lambda bus: bus[1].torque_on())
    rig.real().shaft.load = Load(blocked=1.0)
    rig.do(lambda bus: bus[1].start_move(start + 60 * deg, time=0.2))
    levels = []
    for _ in range(20):
        rig.port.sleep(0.05)
        levels.append(rig.do(lambda bus: bus.protect())[1])
        if levels[-1] is Level.SAFE:
            break
    assert levels[0] is Level.OK
    assert levels[-1] is Level.SAFE
    with pytest.raises(Stopped):
        rig.do(lambda bus: bus[1].start_move(start, time=1.0))
