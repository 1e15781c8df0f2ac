"""The calls behind `import hangtime`, and the results that they return."""
