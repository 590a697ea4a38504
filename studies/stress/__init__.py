"""Stress: a catalogue of extremes for every backend, dtype and dynamic method."""
