"""gsfw.samplers."""
