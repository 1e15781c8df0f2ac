"""Preparation of takes for simulation: held edge, smoothing, noise, camera faults, fitted and held-out takes."""
