"""What ``gsfw new`` writes: a package for each kind of part, which works as it is written."""
