"""Motion in closed form: its evaluation, and its fit to any moving model."""
