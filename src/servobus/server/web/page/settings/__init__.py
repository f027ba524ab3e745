"""What the page of one servo shows and does, without the page: groups of registers, edits, conditions, limits."""
