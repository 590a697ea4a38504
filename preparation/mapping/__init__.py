"""Camera poses and points from matched images, by the mappers of COLMAP."""
