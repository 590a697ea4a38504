"""Method dynamic3dgs: persistent Gaussians, tracked from one time to the next."""
