"""The blind check: a generator of withheld truths, the seal around them, and the scorer."""
