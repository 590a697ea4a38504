"""The gsplat rasterizer: a thin adapter onto the package of that name, to switch and compare."""
