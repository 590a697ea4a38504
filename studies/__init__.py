"""Studies: tables of training runs that are made once, kept, and shown again."""
