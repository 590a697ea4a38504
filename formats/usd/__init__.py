"""OpenUSD: splats as a ParticleField3DGaussianSplat of UsdVol (OpenUSD 26.03), at rest or moving.

Positions, linear scales, opacities in [0, 1], rotations, and the SH coefficients of each splat one
after the other. A stage says which of its axes, y or z, points up.
"""
