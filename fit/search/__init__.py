"""Search algorithms for parameters: each proposes candidates with `ask()` and learns their errors from `tell()`."""

PRINTED_ITERATIONS = 350  # of the annealing, as its paper has it (`fit.search.annealing`)
