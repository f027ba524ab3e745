"""What the page of one servo is built of: registers, conditions, and what is done with the whole servo."""
