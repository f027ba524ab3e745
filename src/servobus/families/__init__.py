"""One folder a family (packets, verbs, models, and the firmware of its virtual servos), and what all families share."""
