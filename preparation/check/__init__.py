"""True if a capture is good enough to train on, found without reconstructing anything."""
