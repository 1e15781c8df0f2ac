"""Parameter identification: request of a fit, its search, and intervals that show which parameters are identifiable."""
