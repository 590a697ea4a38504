"""The ray rasterizer: Gaussians along true rays, at their peak or as a volume; slow and exact."""
