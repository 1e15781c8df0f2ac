"""Compare simulated cloth with takes: residuals of points and of the held edge, free or pulled to the points."""
