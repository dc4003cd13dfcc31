"""Thresholds by which a diagnosis judges, with what they were tuned on, from the modules that hold them."""

from __future__ import annotations

import ast
import importlib
import inspect
from collections.abc import Iterator

from docstring_markup import as_markdown
from tables import code, table

PLACES = {
    "jaxmuscle.diagnosis.evidence": ("TELLING", "LARGEST_P", "LEAST_GAIN", "HALVED", "OUTCOMES"),
    "jaxmuscle.diagnosis.ranking": ("PROMISING", "MOST"),
    "jaxmuscle.diagnosis.pairs": ("LEADERS", "NEEDED"),
    "jaxmuscle.diagnosis.folds": ("FOLDS",),
    "jaxmuscle.diagnosis.verdict": ("MISSING", "FAR_OFF", "ABOVE_NOISE", "IMITATED", "MUCH", "EXPLAINED",
                                    "SURE", "VIOLATED", "SURPRISING"),
    "jaxmuscle.diagnosis.dependence": ("WORTHWHILE", "LEAST_CONSTANT"),
    "jaxmuscle.diagnosis.residual_pattern": ("PERIODS", "LEAST", "VARIES", "CLEARER", "MOVED"),
}  # fmt: skip
"""Module → its thresholds."""
MARK = "<!-- thresholds -->"


def with_thresholds(page: str) -> str:
    """A page with the table in place of the mark."""
    return page.replace(MARK, table(("threshold", "value", "what it is"), _rows())) if MARK in page else page


def _rows() -> Iterator[tuple[str, str, str]]:
    for place, names in PLACES.items():
        module = importlib.import_module(place)
        said = _said(inspect.getsource(module))
        for name in names:
            yield code(name), _value(getattr(module, name)), as_markdown(said[name])


def _said(source: str) -> dict[str, str]:
    """Constant → the text right below it."""
    body = ast.parse(source).body
    pairs = zip(body, body[1:], strict=False)
    return {
        target.id: inspect.cleandoc(below.value.value)
        for node, below in pairs
        if isinstance(node, ast.Assign)
        and isinstance(below, ast.Expr)
        and isinstance(below.value, ast.Constant)
        for target in node.targets
        for target in (target.elts if isinstance(target, ast.Tuple) else [target])
        if isinstance(target, ast.Name)
    }


def _value(value: object) -> str:
    if isinstance(value, dict):
        return "; ".join(f"{name}: {each:g}" for name, each in value.items())
    return f"{value:.3g}" if isinstance(value, float) else str(value)
