"""The mutation tester's own judgement: which changes count, and which may live."""

from __future__ import annotations

import pytest

from tests.mutants.__main__ import SURVIVORS, is_listed, is_wording


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


def zipped(rest):
    return f"for a, b in zip(own, other{rest}):"


@pytest.mark.parametrize(
    ("function", "removed", "added", "may_live"),
    [
        ("fit.gap.gates.of", zipped(", strict=True"), zipped(", "), True),
        ("fit.gap.gates.of", zipped(", strict=True"), zipped(", strict=False"), True),
        ("fit.gap.gates.of", zipped(", strict=True"), zipped(", strict=None"), True),
        ("fit.gap.gates.of", zipped(", strict=True"), "for a, b in zip(own, strict=True):", False),
        ("formats.blocks.of", zipped(", strict=True"), zipped(", "), False),  # files are what others made
        ("formats.blocks.of", "rest.astype(float)", "rest.astype(None)", True),
        ("formats.blocks.of", "rest.astype(int)", "rest.astype(None)", False),
        ("formats.blocks.of", "np.array(rest, float)", "np.array(rest, None)", False),
        ("fit.gap.gates.of", "f'{1e3 * apart:.0f} mm'", "f'{1001.0 * apart:.0f} mm'", True),
        ("fit.gap.gates.of", "f'{1e3 * apart:.3f} mm'", "f'{1001.0 * apart:.3f} mm'", False),
        ("fit.gap.gates.of", "f'{1e3 * apart:.0f} mm'", "f'{1e3 * other:.0f} mm'", False),
        ("fit.gap.gates.of", "1e3 * apart", "1001.0 * apart", False),
        ("fit.gap.gates.of", "a.reshape(len(a), -1) + 1", "a.reshape(len(a), -2) + 1", True),
        ("fit.gap.gates.of", "a.reshape(len(a), -1) + 1", "a.reshape(len(a), +1) + 1", False),
        ("fit.gap.gates.of", "a.reshape(len(a), -1)", "a.reshape(len(b), -1)", False),
        ("fit.gap.gates.of", "a.reshape(len(a), -1).sum(-1)", "a.reshape(len(a), -1).sum(-2)", False),
    ],
)
def test_a_rule_lists_the_changes_of_its_kind_and_no_other(function, removed, added, may_live):
    assert is_listed(SURVIVORS.read_text())(function, f"- {removed}\n+ {added}") is may_live


def test_an_entry_lists_one_change_of_one_function():
    listed = is_listed('[[survivor]]\nfunction = "a.b"\nchange = """\n- x\n+ y\n"""\nreason = "equivalent"\n')
    assert listed("a.b", "- x\n+ y")
    assert not listed("a.c", "- x\n+ y")
    assert not listed("a.b", "- x\n+ z")
