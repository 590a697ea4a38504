"""What a capture became and why, from the measured figures to sentences and a verdict."""
