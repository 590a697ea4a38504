"""Edits of finished splats and models: regions, transforms, alignment, pruning, colours."""
