"""Method 3dgs: static Gaussians."""
