"""Jobs of several steps, written once for both drivers: look, scan, move, make safe, reconfigure, back up."""
