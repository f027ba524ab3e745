"""Virtual servos as ports: in this process, on a pseudo terminal, over TCP."""
