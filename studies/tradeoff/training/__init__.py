"""What a trade costs when it is made before training: variants of a run, each trained."""
