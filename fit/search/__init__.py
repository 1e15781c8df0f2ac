"""Search for parameters: small objects with `ask()` and `tell()`; the caller owns the loop."""
