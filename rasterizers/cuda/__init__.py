"""The CUDA rasterizer: kernels that are compiled where they are used."""
