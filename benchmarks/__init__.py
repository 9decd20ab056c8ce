"""Measurements of vsalog's speed and memory; see README.md."""
