"""Contracts, the training loop, and torch defaults of operators; imports nothing else of gsfw.

Kept empty so that ``gsfw.core.errors`` can be imported without torch.
"""
