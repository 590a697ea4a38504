"""Method 4dgs: canonical Gaussians that a field of space and time deforms."""
