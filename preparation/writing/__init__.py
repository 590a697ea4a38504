"""The data set that training reads: pictures, masks and a model in the layout of COLMAP."""
