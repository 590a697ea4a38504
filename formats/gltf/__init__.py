"""glTF 2.0 with KHR_gaussian_splatting (ratified in 2026): splats as points of a mesh.

Frame of the format: x left, y up, z forward. Scales are linear, opacities in [0, 1], rotations
xyzw, SH coefficients one attribute each, of degree 3 at most.
"""
