"""Ports: bytes out, bytes in, and a clock. Real ones, pseudo terminals, a tap and its replay."""
