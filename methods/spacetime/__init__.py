"""Method spacetime: Gaussians on polynomial paths, with a temporal opacity."""
