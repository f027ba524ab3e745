"""The two drivers, blocking and asyncio: a bus, its servos, the control cycle."""
