"""Motions of a robot, at a fixed rate: planned, played, followed, taught, recorded and kept."""
