"""Find the servos on a port, look at one, move it and come back.

    python examples/first_minute.py [PORT]

Without a port it takes a virtual RX-28 and is done at once. Expect one line for each servo found with an id
below 10, the angle it goes to (30 degrees away), the angle it reached, and "back".
"""

import sys

import servobus
from servobus import deg
from servobus.core import units

port = sys.argv[1] if len(sys.argv) > 1 else "virtual:rx28@1?clock=virtual"

with servobus.open(port) as bus:
    for servo in bus.scan(ids=range(10)):
        print(servo)
    if not len(bus):
        sys.exit("nobody answers: is the power on, and is the id below 10?")

    servo = next(iter(bus))
    position = servo.model.register("present_position")
    start = servo.read(position)
    goal = start + 30 * deg

    with servo.torque():  # off again on the way out, whatever happens
        print(f"going to {units.show(goal, 'rad')}")
        servo.move(goal, speed=60 * deg).wait()
        print(f"now at {units.show(servo.read(position), 'rad')}")
        servo.move(start, speed=60 * deg).wait()
        print("back")
