"""Joints calibrated by hand: which servo, which way, how far, and where the zero is."""
