"""Motor, gear, shaft and load, in plain numbers."""
