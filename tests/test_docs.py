"""Rules of the documentation: links, commands, sentences, generated pages, and a build without warnings."""

from __future__ import annotations

import re
import subprocess
import sys
from functools import cache
from pathlib import Path

import pytest

from docs.conf import whole_page
from docs.generator import commands, effects, equations, rooms
from docs.generator.shown import with_shown_files
from fit.effects import LIBRARY
from tests.sentences import LONGEST_SENTENCE, PRIVATE_WORDS, has_clause_as_subject, sentences_of, words_of

ROOT = Path(__file__).parent.parent
DOCS = ROOT / "docs"
BESIDE_DOCS = ("benchmarks/README.md", "systemd/README.md", "formats/SPEC.md", "formats/SPEC-1.md")
PAGES = sorted([*ROOT.glob("*.md"), *DOCS.rglob("*.md"), *(ROOT / name for name in BESIDE_DOCS)])
LINK = re.compile(r"\[[^\]]*\]\(\s*([^)#\s]*)(?:#([^)\s]+))?\s*\)")


def name_of(path: Path) -> str:
    return str(path.relative_to(ROOT)) if path.is_relative_to(ROOT) else path.name


@cache
def whole_text(page: Path) -> str:
    """Return a page's text with its generated and included parts."""
    return whole_page(page.read_text(), name_of(page))


@cache
def anchors(page: Path) -> frozenset[str]:
    """Return the anchors of a page's headings, by GitHub's rule, which the generator also uses."""
    text = re.sub(r"```.*?```", "", whole_text(page), flags=re.DOTALL)
    shown = [re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", t) for t in re.findall(r"^#{1,4} (.+)$", text, re.MULTILINE)]
    return frozenset(re.sub(r"[^\w\- ]", "", title.lower()).strip().replace(" ", "-") for title in shown)


# --- links --------------------------------------------------------------------------------------


def dead_links(page: Path) -> list[str]:
    text = re.sub(r"```.*?```|`[^`\n]*`", "", page.read_text(), flags=re.DOTALL)
    dead = []
    for target, anchor in LINK.findall(text):
        if "://" in target or target.startswith("mailto:"):
            continue
        path = (page.parent / target).resolve() if target else page
        if not path.exists() or (anchor and path.suffix == ".md" and anchor not in anchors(path)):
            dead.append(f"{name_of(page)}: {target}{'#' if anchor else ''}{anchor}")
    return dead


def test_every_link_leads_to_a_file_and_every_anchor_to_a_heading() -> None:
    assert sum(len(LINK.findall(page.read_text())) for page in PAGES) > 100
    assert [dead for page in PAGES for dead in dead_links(page)] == []


def test_a_link_to_no_file_and_one_to_no_heading_are_both_found(tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    page.write_text("# A title\n\n[a](page.md#a-title) [b](page.md#another) [c](missing.md) [d](https://example.org)\n")
    assert dead_links(page) == ["page.md: page.md#another", "page.md: missing.md"]


def test_a_link_from_a_shown_file_holds_where_the_page_is() -> None:
    """The file lies in `benchmarks/`, and the page that shows it in `docs/reference/`."""
    text = with_shown_files("[a](../docs/decisions/x.md#y) [b](peers.py) [c](../formats/SPEC.md)", "benchmarks/a.md")
    assert text == "[a](../docs/decisions/x.md#y) [b](peers.py) [c](../docs/reference/take-archive.md)"
    shown = with_shown_files("<!-- shown: benchmarks/README.md -->", "docs/reference/benchmarks.md")
    assert "(../decisions/0032-compensated-summation.md)" in shown


def test_a_page_is_read_again_when_the_file_that_it_shows_has_changed(tmp_path: Path) -> None:
    pages, built, shown = tmp_path / "pages", tmp_path / "built", tmp_path / "CHANGES.md"
    pages.mkdir()
    (pages / "index.md").write_text(f"<!-- shown: {shown} -->\n")
    for word in ("sooner", "later"):
        shown.write_text(f"# Changes\n\nThe lamp lights {word}.\n")
        sphinx = [sys.executable, "-m", "sphinx", "--builder", "html", "--fail-on-warning", "--quiet"]
        subprocess.run([*sphinx, "--conf-dir", DOCS, pages, built], check=True)
        assert f"The lamp lights {word}." in (built / "index.html").read_text()


def test_every_page_that_code_names_exists() -> None:
    """Error messages and docstrings send readers to pages."""
    found = []
    for folder in ("formats", "firmware_host", "capture", "fit", "systemd", "scripts", "benchmarks"):
        for path in (ROOT / folder).rglob("*"):
            if path.is_file() and path.suffix in {"", ".py", ".toml", ".service", ".timer", ".html", ".json"}:
                found += [(name_of(path), page) for page in re.findall(r"\bdocs/[\w/-]+\.md", path.read_text())]
    assert len(found) > 10
    assert [f"{file}: {page}" for file, page in found if not (ROOT / page).exists()] == []


# --- generated pages ----------------------------------------------------------------------------


def test_the_commands_page_has_every_command_and_every_option() -> None:
    page = commands.commands_page()
    parts = list(commands.every_command(commands.whole_command()))
    assert len(parts) > 20
    for name, part in parts:
        section = page.split(f"## {name}\n")[1].split("\n## ")[0]
        for parameter in part.params:
            for option in (*parameter.opts, *parameter.secondary_opts):
                if option.startswith("--"):
                    assert option in section, f"{name}: {option}"


def test_the_effects_page_has_every_effect_with_an_equation_its_range_and_its_source() -> None:
    page = effects.effects_page()
    for effect in LIBRARY:
        section = page.split(f"### {effect.name}\n")[1].split("\n### ")[0]
        assert "$$\n" in section, effect.name
        assert f"| range | {effect.low:g} to {effect.high:g} |" in section
        assert "Source: " in section, effect.name


def test_a_plain_equation_becomes_mathml_with_a_fraction_a_root_and_a_greek_letter() -> None:
    tex = equations.to_tex("f = -1/2 rho |v_n| sqrt(1 - xi^2)        [N], v_n = v . n")
    assert tex == (r"f = -\tfrac{1}{2} \rho  |v_{n}| \sqrt{1 - \xi ^{2}}\quad \text{[N]},\quad v_{n} = v \cdot  n")
    mathml = equations.to_mathml(tex, displayed=True)
    for element in ("<mfrac>", "<msqrt>", "&#x003C1;", 'display="block"'):
        assert element in mathml


# --- the architecture ---------------------------------------------------------------------------


def modules_of_the_architecture() -> set[str]:
    """Modules named in the tables of the architecture page, as paths without `.py`."""
    found, room = set(), ""
    for line in (DOCS / "architecture.md").read_text().splitlines():
        if heading := re.match(r"#{2,3} ([\w/]+)(?::| and |$)", line):
            room = heading[1] if " and " not in line else heading[1].split("/")[0]
        elif line.startswith("#"):
            room = ""
        elif line.startswith("| ") and (row := re.match(r"\| `([\w/]+)` \|", line)):
            found |= {f"{room}/{row[1]}"} if room else set()
        elif line.startswith("| ") and room == "fit/effects":
            found |= {f"{room}/{name}" for name in re.findall(r"`(\w+)`", line)}
    return found


def test_the_architecture_page_names_every_module_of_every_room_and_no_other() -> None:
    packages = ("formats", "firmware_host", "capture", "fit")  # `hangtime` only names calls
    modules = {
        name_of(path.with_suffix(""))
        for package in packages
        for path in (ROOT / package).rglob("*.py")
        if path.name != "__init__.py"
    }
    named = {name for name in modules_of_the_architecture() if name.split("/")[0] in packages}
    assert sorted(modules - named) == []
    assert sorted(named - modules) == []


def test_the_drawing_of_the_architecture_has_the_layers_that_import_linter_enforces() -> None:
    """`python -m docs.generator.rooms` draws it anew."""
    (drawn,) = rooms.DRAWING.findall(rooms.PAGE.read_text())
    assert drawn == rooms.drawing()
    assert " gap │ identification " in drawn


# --- sentences ----------------------------------------------------------------------------------

LONGEST_MEAN = 16  # words; plain English guides ask for 15 to 20
LONGEST_LINE = 100  # characters of prose; tables and lines that a link makes longer are left out


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_no_sentence_of_a_page_is_longer_than_25_words_and_their_mean_is_16_at_most(page: Path) -> None:
    sentences = sentences_of(page.read_text())
    assert [sentence for sentence in sentences if words_of(sentence) > LONGEST_SENTENCE] == []
    lengths = [words_of(sentence) for sentence in sentences]
    assert sum(lengths) <= LONGEST_MEAN * len(lengths)


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_no_line_of_prose_is_longer_than_100_characters(page: Path) -> None:
    text = re.sub(r"^```.*?^```", "", page.read_text(), flags=re.DOTALL | re.MULTILINE)
    long = [line for line in text.splitlines() if len(line) > LONGEST_LINE and not line.startswith("|")]
    assert [line for line in long if not re.search(r"\]\([^)]{30,}\)", line)] == []


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_no_sentence_of_a_page_has_a_what_clause_as_its_subject_or_a_private_word(page: Path) -> None:
    sentences = sentences_of(page.read_text())
    assert [text for text in sentences if has_clause_as_subject(text) or PRIVATE_WORDS.search(text)] == []


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_no_sentence_of_a_page_goes_on_with_an_and_as_if_the_one_before_had_not_ended(page: Path) -> None:
    assert [text for text in sentences_of(page.read_text()) if re.match(r"And\b(?!.*\?$)", text)] == []


@pytest.mark.parametrize("page", sorted((DOCS / "how-to").glob("*.md")), ids=name_of)
def test_no_how_to_page_holds_an_equation(page: Path) -> None:
    """Equations are facts of the reference; a dollar sign within code is the shell's."""
    assert "$" not in re.sub(r"```.*?```|`[^`]*`", "", page.read_text(), flags=re.DOTALL)


@pytest.mark.parametrize("page", sorted((DOCS / "decisions").glob("*.md")), ids=name_of)
def test_the_title_of_a_decision_is_a_claim_and_no_what_or_how_clause(page: Path) -> None:
    assert not re.match(r"# \d+\. (?:What|How|Whatever)\b", page.read_text())
    assert not re.match(r"\d{4}-(?:what|how)-", page.name)


def test_a_sentence_of_26_words_is_found_across_a_link_a_piece_of_code_and_an_abbreviation() -> None:
    text = (
        "One "
        + "[word](page.md) " * 20
        + "`some code` at 1.2 mm and then.\n\n| cell | Two words. Three more words. |\n"
    )
    assert [words_of(sentence) for sentence in sentences_of(text)] == [27, 1, 2, 3]


# --- the build ----------------------------------------------------------------------------------


@pytest.mark.slow
def test_the_documentation_builds_without_a_warning_and_asks_nothing_of_the_network(tmp_path: Path) -> None:
    built = tmp_path / "html"
    sphinx = [sys.executable, "-m", "sphinx", "--builder", "html", "--fail-on-warning", "--keep-going", "--quiet"]
    done = subprocess.run(
        [*sphinx, "--doctree-dir", tmp_path / "doctrees", DOCS, built], capture_output=True, text=True, check=False
    )
    assert (done.returncode, done.stderr) == (0, "")
    fetched = re.compile(r"<(?:script|img|iframe)[^>]+src=\"https?:|<link[^>]+href=\"https?:|@import|url\(https?:")
    for path in [*built.rglob("*.html"), *built.rglob("*.css")]:
        assert not fetched.search(path.read_text()), path
    assert "<math" in (built / "reference/effects.html").read_text()
