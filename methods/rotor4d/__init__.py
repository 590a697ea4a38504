"""Method 4d-rotor: Gaussians of space and time; each instant is a slice of them."""
