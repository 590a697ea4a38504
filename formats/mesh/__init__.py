"""Meshes: surfaces fused from depth images that a model renders."""
