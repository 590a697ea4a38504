"""Planning: what a run does with the time that it was given."""
