"""Implementation of `import hangtime`: the calls, and the results that they return."""
