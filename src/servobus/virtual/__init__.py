"""Virtual servos: motor and shaft, memory and snapshots, the wire with its faults, and the ports they are served on."""
