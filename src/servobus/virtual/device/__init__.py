"""One virtual servo: its memory, its firmware by name, its state file."""
