"""gsfw.formats."""
