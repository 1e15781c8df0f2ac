"""Equations as the docstrings write them, in plain text, turned into TeX, and TeX into MathML for the pages.

A docstring is read in a terminal first, so its equations are plain: `f = -1/2 rho c A |v_n| v_n n   [N]`. The plain
form has few rules:

- Greek letters by name
- `_` and `^` with one word or a bracket
- `sqrt(...)`
- a lone dot for a product
- two or more spaces between an equation and its remarks
"""

from __future__ import annotations

import re
from typing import Any

from latex2mathml.converter import convert

GREEK = {"alpha", "beta", "gamma", "delta", "zeta", "eta", "theta", "kappa", "lambda", "mu", "nu", "xi", "pi", "rho"}
GREEK |= {"tau", "phi", "psi", "omega"}
FUNCTIONS = {"sin": r"\sin", "cos": r"\cos", "tanh": r"\tanh", "exp": r"\exp", "max": r"\max"}
SIGNS = {"<-": r"\leftarrow", "~": r"\approx", "±": r"\pm", "<=": r"\le", ">=": r"\ge"}
TOKEN = re.compile(
    r"(?P<gap>\s{2,})"
    r"|(?P<unit>\[[A-Za-z][^\]=]*\](?!\s*=))"
    r"|(?P<rate>(?<![A-Za-z0-9])d2?[A-Za-z]+/d[a-z]+2?(?![A-Za-z]))"
    r"|(?P<fraction>(?<![\w.])\d+/\d+(?![\w.]))"
    r"|(?P<name>[A-Za-z]+\d*'*)"
    r"|(?P<number>\d+(?:\.\d+)?)"
    r"|(?P<sign><-|<=|>=|~|±)"
    r"|(?P<dot>(?<=\s)\.(?=\s))"
    r"|(?P<script>[_^])"
    r"|(?P<space>\s)"
    r"|(?P<other>.)"
)

# The beginning of another equation or a remark within one column of a line.
NEXT = re.compile(r"(?<=[^\s,]), (?=[A-Za-z]\w*(?:\([^)]*\))? =|[\w, ]+ (?:from|alike)\b)|;\s+")


def to_tex(line: str) -> str:
    """Return one line of plain text as TeX."""
    label, colon, rest = line.partition(":")
    if colon and re.fullmatch(r"[a-z]+", label):
        return rf"\text{{{label}: }}\quad " + _tex(rest.strip())
    return _tex(line.strip())


def to_mathml(tex: str, *, displayed: bool) -> str:
    """Return TeX as MathML, which browsers draw by themselves."""
    return convert(tex, display="block" if displayed else "inline")


def _tex(text: str) -> str:
    columns = [column.strip(" ,;") for column in re.split(r"\s{2,}", text)]
    pieces = [piece for column in columns for piece in NEXT.split(column) if piece]
    joined = r",\quad ".join(_piece(piece) for piece in pieces)
    return joined.replace(r",\quad \quad \text{[", r"\quad \text{[")


def _piece(text: str) -> str:
    """Return one equation, unit or remark."""
    words = re.findall(r"(?<![\w\\])[a-z]{3,}(?![\w(])", text)
    words = [word for word in words if word not in GREEK and word not in FUNCTIONS]
    if "=" not in text and "<" not in text and words:
        return "".join(_remark(word) for word in re.split(r"(\s+)", text))
    return _tokens(_roots(text))


def _remark(word: str) -> str:
    """Return a word of a remark: a symbol as a symbol, any other as text."""
    bare = word.rstrip(",")
    if bare in GREEK or re.fullmatch(r"[b-zA-Z]|\w+[_^]\w+|[A-Z]\d+", bare):
        return _tokens(bare) + word[len(bare) :]
    return rf"\text{{{word}}}"


def _roots(text: str) -> str:
    """Return the text with `sqrt(...)` and bracketed scripts in TeX's braces."""
    for opening in ("sqrt(", "^(", "_("):
        while (start := text.find(opening)) >= 0:
            first, depth, end = start + len(opening), 1, start + len(opening)
            while depth and end < len(text):
                depth += {"(": 1, ")": -1}.get(text[end], 0)
                end += 1
            head = {"sqrt(": "\x01", "^(": "^", "_(": "_"}[opening]
            text = f"{text[:start]}{head}\x02{text[first : end - 1]}\x03{text[end:]}"
    return text


def _tokens(text: str) -> str:
    out, script = [], False
    for match in TOKEN.finditer(text):
        kind, token = match.lastgroup, match[0]
        if kind == "script":
            out.append(token)
            script = True
            continue
        tex = _token(kind or "", token)
        out.append(f"{{{tex}}}" if script and token not in "\x02{" else tex)
        script = False
    return "".join(out)


def _token(kind: str, token: str) -> str:
    if kind == "unit":
        return rf"\quad \text{{{token}}}"
    if kind == "rate":
        above, below = token.split("/")
        return rf"\frac{{{_differential(above)}}}{{{_differential(below)}}}"
    if kind == "fraction":
        above, below = token.split("/")
        return rf"\tfrac{{{above}}}{{{below}}}"
    if kind == "name":
        return _name(token)
    if kind == "sign":
        return SIGNS[token] + " "
    if kind == "dot":
        return r"\cdot "
    return {"\x01": r"\sqrt", "\x02": "{", "\x03": "}", " ": " "}.get(token, token)


def _differential(token: str) -> str:
    """Return `d2x` as d squared x, `dkappa` as d kappa."""
    power = "^2" if token.startswith("d2") else ""
    name = token.removeprefix("d2") if power else token[1:]
    after = "^2" if name.endswith("2") else ""
    return rf"d{power} {_name(name.removesuffix('2') if after else name)}{after}"


def _name(token: str) -> str:
    primes = token[len(token.rstrip("'")) :]
    word = token.rstrip("'")
    letters, digits = word.rstrip("0123456789"), word[len(word.rstrip("0123456789")) :]
    if letters in GREEK:
        tex = rf"\{letters} "
    elif letters in FUNCTIONS:
        tex = FUNCTIONS[letters] + " "
    elif letters[0] == "d" and letters[1:] in GREEK:
        tex = rf"d\{letters[1:]} "
    elif letters == "integral":
        return r"\int "
    elif letters == "of":
        return ""
    elif len(letters) == 2 and letters[0] == "d":
        tex = rf"d{letters[1]}"
    elif len(letters) <= 1 or letters in {"Fu", "Fv"}:
        tex = letters if len(letters) <= 1 else rf"{letters[0]}_{{{letters[1]}}}"
    else:
        tex = rf"\mathrm{{{letters}}}"
    return tex + (f"_{{{digits}}}" if digits else "") + primes


def visit_math(translator: Any, node: Any) -> None:
    """Write an equation in a sentence."""
    from docutils import nodes

    translator.body.append(to_mathml(node.astext(), displayed=False))
    raise nodes.SkipNode


def visit_math_block(translator: Any, node: Any) -> None:
    """Write an equation of its own line."""
    from docutils import nodes

    translator.body.append(f'<div class="equation">{to_mathml(node.astext(), displayed=True)}</div>')
    raise nodes.SkipNode
