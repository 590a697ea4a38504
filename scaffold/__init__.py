"""Packages that ``gsfw new`` writes, one for each kind of part; they work as they are written."""
