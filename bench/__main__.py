"""The measurements, one after the other: `python -m bench [--quick]`; each alone: `python -m bench.reads` and so on."""

import sys

from bench import foreign, latency, play, reads, robot, server, startup, ticks, wire

reads.main(sys.argv[1:])
startup.main([])
print()
wire.main([])
print()
latency.main([])
print()
server.main(["--quick"] if "--quick" in sys.argv else [])
print()
ticks.main([])
print()
robot.main(["--quick"] if "--quick" in sys.argv else [])
print()
play.main(["--seconds", "3"] if "--quick" in sys.argv else [])
print()
server.main(["--quick"] if "--quick" in sys.argv else [])
print()
foreign.main(["--quick"] if "--quick" in sys.argv else [])
