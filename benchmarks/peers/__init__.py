"""A bench of peers: several trainers on the same images, scored by one script (see README.md)."""
