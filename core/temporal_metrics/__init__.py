"""Metrics of moving scenes over time."""
