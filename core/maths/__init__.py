"""Geometry, rotations, spherical harmonics and image similarity."""
