"""Joints of a robot: read, moved, stopped and protected by name, over ports and families."""
