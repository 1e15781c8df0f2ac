"""What holds for the documentation: links, commands, sentences, generated pages, and a build without warnings."""

from __future__ import annotations

import re
import subprocess
import sys
from functools import cache
from pathlib import Path

import pytest

from docs.conf import GENERATED
from docs.generator import commands, effects, equations
from fit.effects import LIBRARY

ROOT = Path(__file__).parent.parent
DOCS = ROOT / "docs"
PAGES = sorted(
    [*ROOT.glob("*.md"), *DOCS.rglob("*.md"), *(ROOT / name for name in ("benchmarks/README.md", "systemd/README.md"))]
)
LINK = re.compile(r"\[[^\]]*\]\(\s*([^)#\s]*)(?:#([^)\s]+))?\s*\)")


def name_of(path: Path) -> str:
    return str(path.relative_to(ROOT)) if path.is_relative_to(ROOT) else path.name


@cache
def whole_text(page: Path) -> str:
    """A page's text with what is generated or included in it."""
    text = page.read_text()
    for marker, make in GENERATED.items():
        if marker in text:
            text = text.replace(marker, make())
    return re.sub(r"```\{include\} (\S+)\n.*?```", lambda m: (page.parent / m[1]).read_text(), text, flags=re.DOTALL)


@cache
def anchors(page: Path) -> frozenset[str]:
    """The anchors of a page's headings, by GitHub's rule, which the generator follows too."""
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
