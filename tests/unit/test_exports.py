"""What `servobus` offers by name."""

import servobus

NAMED = {
    *(
        "Bus",
        "AsyncBus",
        "Servo",
        "BusServo",
        "AsyncBusServo",
        "Cycle",
        "Readings",
        "Level",
        "Thresholds",
        "Snapshot",
        "Backup",
    ),
    *("ByServo", "ReconnectReport", "Watchdog", "MotionError", "BusError", "RX28", "DRS0602", "LX16A", "deg", "open"),
}


def test_M6_dir_lists_what_users_name_and_little_else() -> None:
    listed = dir(servobus)
    assert set(listed) >= NAMED
    assert set(listed) == {*servobus.__all__, "__doc__", "__version__"}
    assert not {"link", "core", "bus", "families", "jobs", "transports"} & set(listed)


def test_M6_every_name_is_there() -> None:
    assert all(getattr(servobus, name) is not None for name in dir(servobus))
    assert servobus.AsyncBus.__module__ == "servobus.bus.asyncio"


def test_a_name_that_is_not_there_is_an_attribute_error() -> None:
    assert not hasattr(servobus, "asyncbus")
