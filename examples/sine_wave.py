"""Send a wave through a row of servos: each move starts them together, and they arrive together.

    python examples/sine_wave.py [PORT]

Without a port it takes four virtual RX-28. Expect 16 lines with the angle of each servo, in which a wave of
20 degrees travels from left to right, and then "calm".
"""

import math
import sys

import servobus
from servobus import deg

port = sys.argv[1] if len(sys.argv) > 1 else "virtual:rx28@1-4?clock=virtual"
height, steps = 20 * deg, 16

with servobus.open(port) as bus:
    rest = {servo.id: servo.state.position for servo in bus.scan(ids=range(10)) if servo.state}

    with bus.torque():
        for step in range(steps):
            phase = 2 * math.pi * step / steps
            wave = {id: at + height * math.sin(phase - place) for place, (id, at) in enumerate(rest.items())}
            bus.move(wave, time=0.25).wait()
            angles = bus.read_all("present_position")
            print("  ".join(f"{angle / deg:6.1f}" for angle in angles.values()))
        bus.move(rest, time=0.5).wait()
        print("calm")
