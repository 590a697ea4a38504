"""Reports: self-contained HTML pages of runs, to look at and to send."""
