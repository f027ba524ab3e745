"""Making servos safe when a program ends or hangs, and when heat or a stall asks for it."""
