"""Overheard bytes as requests, answers and troubles; recordings of them."""
