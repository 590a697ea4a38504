"""Stereo: surface points from images of known cameras."""
