"""What is said on a bus: values and units, registers, framing, exchanges. Knows no port, no clock and no family."""
