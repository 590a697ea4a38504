"""Discovery of plugins, choice among their parts, and composition of a run."""
