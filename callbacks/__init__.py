"""gsfw.callbacks."""
