"""Blind check of the diagnosis: generated cases with sealed labels, and the scoring of answers."""
