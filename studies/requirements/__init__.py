"""What a scene required of a model: where its floats went, what each bought, what was left out."""
