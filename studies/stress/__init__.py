"""Stress: the catalogue of extremes, which every backend, dtype and dynamic method is held to."""
