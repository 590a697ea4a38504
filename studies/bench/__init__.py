"""Timing of rendering and training."""
