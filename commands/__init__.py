"""gsfw.commands."""
