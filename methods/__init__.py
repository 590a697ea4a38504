"""gsfw.methods."""
