"""Other people's engines as generators of the blind check."""
