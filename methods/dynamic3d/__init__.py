"""Method dynamic3dgs: Gaussians that persist and are tracked from one time to the next."""
