"""Find the garment in a frame and follow its points: silhouette, corners, folds, what hides what."""
