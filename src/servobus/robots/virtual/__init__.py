"""The robot of a file on virtual servos, in this program or behind ports for others."""
