"""The settings that the servos of a robot keep: compared with its file, written, and brought back."""
