"""Drive smart serial-bus servos, and be them."""

__version__ = "0.1.0"
