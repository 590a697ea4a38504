"""Method 4d-rotor: Gaussians of space and time, of which every instant shows a slice."""
