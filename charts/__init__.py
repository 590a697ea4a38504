"""Charts on matplotlib: one file per kind of chart, one house style."""
