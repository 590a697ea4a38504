"""`gsfw tradeoff`: variants of a finished model, or of a training run."""
