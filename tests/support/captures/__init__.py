"""Small captures as other programs write them, one module for each format."""
