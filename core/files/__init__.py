"""Atomic writes, locks and JSON."""
