"""The wire between a client and virtual servos, in bit times, and what goes wrong on it."""
