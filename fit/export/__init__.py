"""Export of a fit as files for other programs."""
