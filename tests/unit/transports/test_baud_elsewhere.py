"""Ports whose speed on the wire is set elsewhere, such as those behind a TCP port."""

import threading

import servobus
from servobus.virtual.serve.ports import TcpPort
from servobus.virtual.serve.rig import build_rig
from servobus.virtual.serve.spec import Setup, parse_specs


def test_a_servo_behind_a_tcp_port_is_found_once_though_it_answers_at_any_speed() -> None:
    stop = threading.Event()
    with TcpPort(build_rig(Setup(parse_specs("rx28@1-3")))) as port:
        server = threading.Thread(target=port.serve, args=[stop])
        server.start()
        try:
            with servobus.open(port.name, bauds=(57_600, 115_200, 1_000_000)) as bus:
                assert [(one.id, one.baud) for one in bus.scan(ids=range(5))] == [(1, 57_600), (2, 57_600), (3, 57_600)]
                assert bus.find(2, family="dynamixel") is bus[2]
        finally:
            stop.set()
            server.join()
