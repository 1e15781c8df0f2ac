"""Other people's simulators, each in a Python of its own; belongs neither to the tool nor to the blind check."""
