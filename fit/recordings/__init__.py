"""Make takes ready for simulation: held edge, smoothing, noise, impossible points, fitted and held-out takes."""
