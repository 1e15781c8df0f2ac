"""Residuals between simulated and tracked points, of the cloth and of the held edge, with or without observer pull."""
