"""HTML from templates of the package: texts are escaped, styles and scripts inlined."""

from __future__ import annotations

import re
from functools import cache
from importlib.resources import files
from typing import TYPE_CHECKING

from jaxmuscle import formatting

if TYPE_CHECKING:
    from jinja2 import Template

SUBSCRIPT = re.compile(r"\b([A-Za-z])_([A-Za-z0-9]{1,2})\b")
"""A symbol as docstrings write it: ``F_c``, ``f_s/n``."""


@cache
def template(name: str, package: str = "jaxmuscle") -> Template:
    """A template of a package's folder, in which ``asset(NAME)`` is a file of that folder as it is.

    Its library is loaded with the first page, not with the classes that a notebook shows.
    """
    from jinja2 import Environment, PackageLoader, StrictUndefined
    from markupsafe import Markup, escape

    environment = Environment(
        loader=PackageLoader(package, "."),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters.update(words=formatting.words, capital=formatting.capital, percent=formatting.percent)
    environment.filters["subscripts"] = lambda text: Markup(
        SUBSCRIPT.sub(r"\1<sub>\2</sub>", str(escape(text)))
    )
    environment.globals["asset"] = lambda file: Markup(files(package).joinpath(file).read_text("utf-8"))
    return environment.get_template(name)
