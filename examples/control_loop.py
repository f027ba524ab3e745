"""A control loop at 20 Hz: a slow wave out, positions, speeds and loads back.

    python examples/control_loop.py [PORT]

Without a port it takes four virtual RX-28 on a virtual clock. Expect the packets of a cycle, then what was lost, then
how many turns there were.
"""

import math
import sys

import servobus
from servobus import deg

port = sys.argv[1] if len(sys.argv) > 1 else "virtual:rx28@1-4?clock=virtual"

with servobus.open(port) as bus:
    rest = {servo.id: servo.state.position for servo in bus.scan(ids=range(10)) if servo.state}
    cycle = bus.cycle()
    print(cycle)

    pace = cycle.every(0.05)
    with bus.torque():
        cycle.run(rest)  # the first goals take longer: limits and torque are read, once
        for tick in pace:
            swing = 10 * deg * math.sin(2 * math.pi * 0.5 * tick.time)
            seen = cycle.run({id: at + swing for id, at in rest.items()})
            if seen.lost:
                print(f"{tick.time:.2f} s: {seen.diagnosis}")
            if tick.time >= 2:
                break
    print(f"{pace.ticks} turns, {pace.missed} missed")
