"""Make takes ready for simulation: held edge, smoothing, noise, fitted and held-out takes."""
