"""Mutation testing: which tests guard which code, and the mutants that may live (`scripts/mutants`)."""
