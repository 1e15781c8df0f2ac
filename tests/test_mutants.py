"""The mutation tester's own judgement: which changes count."""

from __future__ import annotations

import pytest

from tests.mutants.__main__ import is_wording


@pytest.mark.parametrize(
    ("lines", "is_only_wording"),
    [
        (['-  advice="move it inside"', '+  advice="MOVE IT INSIDE"'], True),
        (['-  f("the {x} is odd, so")', '+  f("XXthe {x} is odd, soXX")'], True),
        (['-  "radius_m",', '+  "XXradius_mXX",'], False),
        (['-  where="annealing", advice="move it"', '+  where="ANNEALING", advice="move it"'], False),
        (['-  advice="move it"', "+  advice=None"], False),
        (["-  a < b", "+  a <= b"], False),
        (["-  a = 1", "+  a = 1"], False),
    ],
)
def test_only_a_sentence_in_other_letters_is_no_mutant_that_counts(lines, is_only_wording):
    assert is_wording(lines) is is_only_wording
