"""One process owns the ports and shares them; another serves pages and an API, and may die."""
