"""Formulas of a page, marked by arithmatex, as MathML, which browsers show without scripts or fonts."""

from __future__ import annotations

import html
import re

from latex2mathml.converter import convert

MARKED = re.compile(r'<(?P<tag>span|div) class="arithmatex">(?P<body>.*?)</(?P=tag)>', re.S)

NAMED = re.compile(r"(?P<sign>[_^])\{(?P<word>[A-Za-z]{2,})\}")
"""Subscripts that are words: upright, as names."""


def with_mathml(page: str) -> str:
    """A page of HTML with its formulas rendered."""
    return MARKED.sub(_rendered, page)


def _rendered(found: re.Match[str]) -> str:
    formula = NAMED.sub(r"\g<sign>{\\mathrm{\g<word>}}", html.unescape(found["body"]).strip())
    displayed = formula.startswith("\\[")
    mathml = convert(formula[2:-2].strip(), display="block" if displayed else "inline")
    return f'<div class="formula">{mathml}</div>' if displayed else mathml
