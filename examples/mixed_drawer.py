"""Empty the rig onto one port: servos of two families, each at its own speed, in one program.

    python examples/mixed_drawer.py [PORT]

Without a port it takes two virtual RX-28 and two LX-16A. Expect a line for each, a table of temperatures,
and all of them 15 degrees further on. The bus changes its speed for each family by itself; on a real
port both kinds need wiring that carries both.
"""

import sys

import servobus
from servobus import deg

port = sys.argv[1] if len(sys.argv) > 1 else "virtual:rx28@1-2,lx16a@3-4?clock=virtual"

# LX servos cannot say of which model they are.
with servobus.open(port, models="lx16a") as bus:
    for servo in bus.scan(ids=range(1, 10)):
        print(servo)
    for trouble in bus.survey.troubles:
        print(trouble)

    for servo, value in bus.read_all("present_temperature").items():
        print(f"id {servo.id}: {value:.0f} °C")

    before = bus.read_all("present_position")
    with bus.torque():
        bus.move({servo: angle + 15 * deg for servo, angle in before.items()}, time=1.0).wait()
        after = bus.read_all("present_position")
    for servo, angle in after.items():
        print(f"{servo.model.title} id {servo.id} turned by {(angle - before[servo]) / deg:.1f}°")
