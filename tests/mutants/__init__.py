"""Mutation testing: the tests of each module, and the accepted surviving mutants (`scripts/mutants`)."""
