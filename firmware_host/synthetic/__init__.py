"""A synthetic world with known truth: a swung hanger, a cloth with physics of its own, and a depth camera's faults."""
