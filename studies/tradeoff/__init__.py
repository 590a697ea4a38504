"""Tradeoff: what a finished model can give up, without training, and what that costs."""
