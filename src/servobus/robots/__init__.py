"""Robots: joints by name over ports and families, their poses and motions."""
