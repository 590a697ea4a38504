"""Studies: measurements of runs, models and rasterizers, and tables of training runs."""
