"""Takes, written for other programs."""
