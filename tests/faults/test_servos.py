"""What happens to servos: alarms, shutdowns, brownouts, cut chains (F12 to F15)."""

import pytest

from faults.rig import FaultRig
from samples import minds_overload, models_that, sample_models
from servobus import NoReply, Refused, Restarted, TorqueOff, deg, dynamixel1, herkulex
from servobus.virtual.physics.motor import Load
from unit.lossy import ASYNC, DRIVERS, SYNC


@DRIVERS
@sample_models
@pytest.mark.parametrize("cause", ["heat", "voltage"])
def test_F12_an_alarm_shows_at_its_joint_and_latches(key: str, cause: str, driver: str) -> None:
    """Heat or a bad supply at one servo: its flag stands beside the values of that servo alone, stays latched when it
    is over, and goes with `rearm`."""
    rig = FaultRig(key, driver)
    flag = rig.sample.hot if cause == "heat" else rig.sample.flat
    real = rig.real(2)
    if cause == "heat":
        real.temperature = 110.0
    else:
        real.voltage = 4.0
    rig.port.sleep(1.0)  # HerkuleX looks for 504 ms before it calls it an alarm (4-2 NO 34)
    for id in (1, 2, 3):
        assert rig.try_position(id) == "right"
        rig.do(lambda bus, number: bus[number].read_alarms(), id)
    assert [rig.bus[id].alarms & flag for id in (1, 2, 3)] == [0, flag, 0]
    real.temperature, real.voltage = 25.0, real.model.sheet.nominal_voltage or 12.0
    rig.port.sleep(1.0)
    rig.do(lambda bus: bus[2].read_alarms())
    assert rig.bus[2].latched & flag
    rig.do(lambda bus: bus[2].rearm())
    assert rig.bus[2].latched == rig.bus[2].alarms == 0


REFUSALS = [
    # Bytes by the RX-28 manual: 3-2 instructions, 3-3 error bits, checksum by 3-2-1.
    ("goal beyond the angle limits", "FF FF 01 05 03 1E FF 03 D6", dynamixel1.Error.ANGLE_LIMIT),
    ("value out of range", "FF FF 01 05 03 1E FF FF DA", dynamixel1.Error.RANGE),
    ("unknown instruction", "FF FF 01 02 07 F5", dynamixel1.Error.INSTRUCTION),
    ("wrong checksum", "FF FF 01 04 03 19 01 DE", dynamixel1.Error.CHECKSUM),
]


@DRIVERS
@pytest.mark.parametrize(("request_", "flag"), [case[1:] for case in REFUSALS], ids=[case[0] for case in REFUSALS])
def test_F12_what_an_rx28_refuses_is_an_exception(request_: str, flag: int, driver: str) -> None:
    """Error bits that refuse an instruction raise Refused with that flag, and are no alarm of the servo."""
    rig = FaultRig("rx28", driver)
    rig.real().memory.store(rig.model.register("ccw_angle_limit"), 500)
    exchange = dynamixel1.write_data(1, 30, b"\x00\x00").mapped(lambda packet: packet.code)
    exchange.request = bytes.fromhex(request_)
    assert rig.do(lambda bus: bus.do(exchange)) == flag  # so says the servo
    asked = dynamixel1.write_data(1, 30, b"\x00\x00")
    asked.request = exchange.request
    with pytest.raises(Refused) as caught:
        rig.do(lambda bus: bus.do(asked))
    assert caught.value.flags == flag
    assert rig.bus[1].alarms == rig.bus[1].latched == 0


@DRIVERS
def test_F12_a_herkulex_keeps_its_error_until_it_is_cleared(driver: str) -> None:
    """Status Error and Detail of a garbled request: in the alarms of the next answer, until `rearm` writes 0 (6-3)."""
    rig = FaultRig("drs0602", driver)
    rig.port.write(bytes.fromhex("FF FF 07 01 07 02 FE"))  # STAT with a wrong checksum: 07^01^07 = 01, so 00 FE
    rig.port.sleep(0.05)
    assert rig.try_position() == "right"
    assert rig.bus[1].alarms == herkulex.StatusError.INVALID_PACKET
    assert rig.try_position() == "right"
    assert rig.bus[1].latched == herkulex.StatusError.INVALID_PACKET
    rig.do(lambda bus: bus[1].rearm())
    rig.read()
    assert rig.bus[1].alarms == rig.bus[1].latched == 0


@DRIVERS
@models_that(minds_overload)
def test_F13_after_an_overload_nothing_jumps(key: str, driver: str) -> None:
    """Blocked until it lets go: `rearm` brings the torque back where the shaft is by then, not where its goal was."""
    rig = FaultRig(key, driver, ids="1")
    start = rig.real().position
    rig.do(lambda bus: bus[1].torque_on())
    rig.real().shaft.load = Load(blocked=1.0)
    rig.do(lambda bus: bus[1].start_move(start + 60 * deg, time=0.5))
    rig.port.sleep(4.0)
    assert not rig.real().torque
    rig.do(lambda bus: bus[1].ping())
    rig.read()
    assert rig.bus[1].alarms
    rig.real().shaft.load = Load()
    here = start - 40 * deg
    rig.real().turn_shaft(here)
    rig.port.sleep(0.1)
    rig.do(lambda bus: bus[1].rearm())
    for _ in range(50):
        rig.port.sleep(0.02)
        assert rig.real().position == pytest.approx(here, abs=1 * deg)
    assert rig.real().torque


@DRIVERS
@sample_models
def test_F14_a_brownout_is_found_out_and_the_joint_stays_still(key: str, driver: str) -> None:
    """A servo that restarts in the middle of a run: `verify` raises Restarted, moves are refused until the torque is
    switched on anew, and the others go on."""
    rig = FaultRig(key, driver)
    for id in (1, 2):
        rig.do(lambda bus, number: bus[number].torque_on(), id)
        rig.do(lambda bus, number: bus[number].verify(), id)
    rig.inject("reboot@1#1:10ms")
    with_error = rig.bus[1].restarted
    rig.try_position(3)
    rig.port.sleep(1.0)
    goal = rig.real().position + 20 * deg
    with pytest.raises(Restarted):
        rig.do(lambda bus: bus[1].verify())
    assert (with_error, rig.bus[1].restarted, rig.bus[2].restarted) == (False, True, False)
    with pytest.raises(TorqueOff):
        rig.do(lambda bus: bus[1].start_move(goal, time=0.5))
    rig.do(lambda bus: bus[2].verify())
    rig.do(lambda bus: bus[1].torque_on())
    rig.do(lambda bus: bus[1].start_move(goal, time=0.5))
    rig.port.sleep(1.5)
    assert rig.real().position == pytest.approx(goal, abs=3 * deg)


@DRIVERS
@sample_models
def test_F15_a_cut_chain_loses_only_what_is_behind_the_cut(key: str, driver: str) -> None:
    """Servos 3 to 5 are off for a while: NoReply for these alone, all others right; plugged in again, all are."""
    rig = FaultRig(key, driver, ids="1-5")
    rig.inject("unplug@3-5#1-")
    for id in range(1, 6):
        if id < 3:
            assert rig.try_position(id) == "right"
        else:
            with pytest.raises(NoReply):
                rig.read(id)
    lost = sorted(id for (_, id, _), counts in rig.bus.stats.servos.items() if counts.timeouts)
    assert lost == [3, 4, 5]
    rig.port.rig.lines[0].plug(rig.reals[2:], rig.port.now())
    rig.inject(None)
    rig.port.sleep(1.0)
    for id in range(1, 6):
        assert rig.try_position(id) == "right"


@pytest.mark.parametrize("driver", [SYNC, ASYNC])
@sample_models
def test_F15_one_servo_unplugged_and_plugged_again(key: str, driver: str) -> None:
    """One servo of five is off for 40 requests: it alone is silent, and answers again when it is back."""
    rig = FaultRig(key, driver, ids="1-5", options="&boot_time=off")
    rig.inject("unplug@2#20-60")
    silent = [id for _ in range(20) for id in range(1, 6) if rig.try_position(id) == "NoReply"]
    assert set(silent) == {2}
    assert rig.verdicts.count("right") == 100 - len(silent)
    assert rig.try_position(2) == "right"
