"""HTML pages that need nothing but themselves: templates of this folder, with styles and scripts inlined."""

from __future__ import annotations

from functools import cache
from importlib.resources import files
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from jaxmuscle import formatting


def rendered(template: str, **content: Any) -> str:
    """The page of a template: texts are escaped, ``asset(NAME)`` is a file of the package as it is."""
    return _environment().get_template(template).render(**content)


@cache
def _environment() -> Environment:
    environment = Environment(
        loader=PackageLoader("jaxmuscle.report", "."),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters.update(words=formatting.words, capital=formatting.capital, percent=formatting.percent)
    environment.globals["asset"] = _asset
    return environment


def _asset(name: str) -> Markup:
    """A style sheet or script that comes with the package."""
    return Markup(files("jaxmuscle.report").joinpath(name).read_text(encoding="utf-8"))
