"""Trade-offs between quality, size and speed of a finished model, without training."""
