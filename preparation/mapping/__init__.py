"""Camera poses and points from matched pictures, by the mappers of COLMAP."""
