"""Trade-offs before training: variants of a run, each trained."""
