"""COLMAP models: binary and text files, read without trusting their counts."""
