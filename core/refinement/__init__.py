"""Refiners run in order, the statistics that they share, and the budget."""
