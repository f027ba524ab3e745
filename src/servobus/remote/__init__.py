"""A bus that another process owns: what is said between that process and its clients, and the client's side of it."""
