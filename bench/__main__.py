"""All measurements, one after the other: `python -m bench`; each alone: `python -m bench.reads` and so on."""

from bench import latency, reads, ticks

reads.main([])
print()
latency.main([])
print()
ticks.main([])
