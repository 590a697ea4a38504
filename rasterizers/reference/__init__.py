"""The reference rasterizer: the conventions of splatting in plain torch, stage by stage."""
