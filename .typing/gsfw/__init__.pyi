"""gsfw: Gaussian splatting, static and dynamic."""

__version__: str
