"""Speak HerkuleX itself: S_JOG moves two servos with one packet and sets their lights with it.

    python examples/herkulex_s_jog.py [PORT]

For DRS-0602 servos with ids 1 and 2. Without a port it takes virtual ones. Expect the bytes of the packet,
and for each servo its angle and status once it has arrived: "inposition" and "torque_on".
"""

import sys

import servobus
from servobus import DRS0602, deg, herkulex

port = sys.argv[1] if len(sys.argv) > 1 else "virtual:drs0602@1-2?clock=virtual"
goal = DRS0602.calibrated_position.scale  # a JOG takes raw numbers; the table knows what they mean

with servobus.open(port, bauds=115_200) as bus:
    pair = [bus.find(id, family="herkulex") for id in (1, 2)]
    with bus.torque():
        right = herkulex.Jog(1, goal.encode(30 * deg), led=herkulex.Led.GREEN)
        left = herkulex.Jog(2, goal.encode(-30 * deg), led=herkulex.Led.BLUE)
        request = herkulex.s_jog(254, playtime=60, jogs=[right, left])  # to all, in 60 x 11.2 ms
        print(request.request.hex(" ").upper())
        bus.do(request)
        bus.transport.sleep(1.0)  # the bus has its own time: virtual servos need not keep us waiting
        for servo in pair:
            status = bus.do(herkulex.stat(servo.id))
            angle = servo.read(DRS0602.calibrated_position)
            print(f"id {servo.id}: {angle / deg:.1f}°, {DRS0602.status_detail.show(status.status_detail)}")
