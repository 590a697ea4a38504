"""Compact forms of a model file's arrays: half precision, and steps with an entropy coder."""
