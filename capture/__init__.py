"""Detect the hanger and the garment in every frame, track their points and record them as a take."""
