"""Detect the garment in a frame and track its points: silhouette, corners, folds and occlusion."""
