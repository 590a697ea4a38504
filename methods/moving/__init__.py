"""Shared parts of the methods for moving scenes."""
