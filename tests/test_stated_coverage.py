"""One page states how many intervals of least squares hold the truth; the others link to it."""

from __future__ import annotations

import re

from tests.repository import ROOT

# A share before or behind the words; 90 % is the intervals' own name.
STATED = re.compile(
    r"(?<!\d)(?!90 )(\d+) %[^.|]*\bhold the truth|intervals that hold the truth \| (\d+) %|\bhold the truth in (\d+) %"
)
KINDS = ("explanation", "how-to", "reference", "tutorial")
PAGES = [ROOT / "README.md", ROOT / "CHANGELOG.md"]
PAGES += [page for kind in KINDS for page in (ROOT / "docs" / kind).glob("*.md")]


def test_the_coverage_of_least_squares_in_air_is_stated_once_and_is_the_benchmarks_own():
    found = {}
    for page in PAGES:
        text = " ".join(page.read_text().split())
        for said in STATED.finditer(text):
            if "other searches" not in text[max(0, said.start() - 80) : said.start()]:
                found.setdefault(page.relative_to(ROOT).as_posix(), []).append(next(filter(None, said.groups())))
    known = re.search(
        r"\| intervals of least squares that hold the truth: .*?\| (\d+) %", (ROOT / "benchmarks/README.md").read_text()
    )
    assert known is not None
    assert found.pop("docs/reference/search.md")[0] == known[1] == "91"
    assert [page for page, values in found.items() if page != "docs/reference/diagnosis.md"] == []
