"""What methods for moving scenes share."""
