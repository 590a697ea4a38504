"""The data set that training reads: images, masks and a model in the layout of COLMAP."""
