"""Fit the parameters of a method to takes: request, trials, saved search, and what motion can tell."""
