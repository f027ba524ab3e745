"""How much a run of the tests covers; tests/conftest.py sets it before any other file of the tests is read."""

everything = False
"""Whether `--all` was given: each model where else a few stand for all, and more examples of each property."""
