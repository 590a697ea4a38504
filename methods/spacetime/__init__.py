"""Method spacetime: Gaussians that move along polynomials, and come and go in time."""
