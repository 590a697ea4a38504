"""Method 4dgs: canonical Gaussians, deformed by a field of space and time."""
