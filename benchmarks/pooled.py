"""Print the pooled rates of several scored sets, as the blind check's tables quote them.

Run: python benchmarks/pooled.py ANSWERS [ANSWERS ...], folders that `hangtime blind score` has scored. Opens no seal.
"""

from __future__ import annotations

import argparse
from pathlib import Path

from fit.blind.cli import print_rates, print_score
from fit.blind.judging import Judged
from fit.blind.rates import rate_of
from fit.blind.scoring import load_score, summarise


def main(arguments: list[str] | None = None) -> None:
    """Print every rate of all cases, and the rates that single sets omit."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("answers", type=Path, nargs="+")
    scores = [load_score(folder) for folder in parser.parse_args(arguments).answers]
    pooled = summarise(tuple(case for score in scores for case in score.cases))
    print(f"{len(pooled.cases)} cases of {len(scores)} sets")
    print_score(pooled)
    counted = [case for case in pooled.cases if case.is_tested]

    def larger(kind: str, least: float) -> list[Judged]:
        return [c for c in counted if c.kind == kind and (c.ratio or 0.0) >= least]

    named = [c for c in counted if c.kind == "single" and c.named]
    print_rates((
        ("right group first, from 2 x detectable", rate_of(bool(c.right_first) for c in larger("single", 2.0))),
        ("right, where something is named for a single", rate_of(bool(c.right_first) for c in named)),
        ("pairs from 0.5 x detectable: both named", rate_of(bool(c.both_named) for c in larger("pair", 0.5))),
        ("above 400 simulations a take", rate_of((c.simulations or 0.0) > 400 for c in counted)),
    ))  # fmt: skip


if __name__ == "__main__":
    main()
