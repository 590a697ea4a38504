"""Finding plugins, choosing among what they register, and composing a run."""
