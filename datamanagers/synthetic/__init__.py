"""The built-in scene: textured solids on a disc, ray-cast in closed form, without splats."""
