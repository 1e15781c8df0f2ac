"""A synthetic world with known truth: a swung hanger, an independent cloth simulation, and a depth camera's faults."""
