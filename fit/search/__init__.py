"""Search algorithms for parameters: each proposes candidates with `ask()` and learns their errors from `tell()`."""
