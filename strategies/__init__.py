"""gsfw.strategies."""
