"""Gaussian parallel training: the rows of a model and the images are divided among processes."""
