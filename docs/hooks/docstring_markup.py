"""Docstrings of the package, written with roles of reStructuredText, as Markdown: an extension of griffe."""

from __future__ import annotations

import re
import textwrap
from typing import Any

import griffe

ROLE = re.compile(r":(?P<role>[a-z]+):`(?P<text>[^`]+)`", re.S)
LITERAL = re.compile(r"(?<!`)``(?P<text>[^`]+)``(?!`)", re.S)
DISPLAYED = re.compile(
    r"^(?P<indent> *)\.\. math::(?P<first>.*)\n"
    r"(?P<rest>(?:(?P=indent) +\S.*\n|(?=\n)\n(?=(?P=indent) +\S))*)",
    re.M,
)
SCRIPT = re.compile(r"::\n\n(?P<body>(?:    .*\n|\n)+)")
SINGLE = re.compile(r"(?<![`\w])`(?P<name>[A-Za-z_][\w.]*)`(?!`)")

SEVERAL = re.compile(r"^ {4}(?P<names>\w+(?:, \w+)+): ", re.M)
"""Parameters that are described together; to griffe all after a space would be a type."""
UNBROKEN = ",\u00a0"


class DocstringMarkup(griffe.Extension):
    """Turns the markup of every docstring before it is rendered."""

    def on_object(self, *, obj: griffe.Object, **kwargs: Any) -> None:
        """Called for every object of the package once it is loaded."""
        if obj.docstring:
            obj.docstring.value = as_markdown(obj.docstring.value)


def as_markdown(text: str) -> str:
    """Roles as code, links or formulas, double backticks as code, displayed formulas between dollars."""
    text = SEVERAL.sub(lambda found: found[0].replace(", ", UNBROKEN), text)
    text = DISPLAYED.sub(_displayed, text + "\n").rstrip("\n")
    text = SCRIPT.sub(
        lambda found: f":\n\n```python\n{textwrap.dedent(found['body']).strip()}\n```\n", text + "\n"
    )
    text = ROLE.sub(_role, text.rstrip("\n"))
    return LITERAL.sub(lambda found: f"`{' '.join(found['text'].split())}`", text)


def _displayed(found: re.Match[str]) -> str:
    formula = " ".join(f"{found['first']} {found['rest']}".split())
    return f"{found['indent']}$$\n{found['indent']}{formula}\n{found['indent']}$$\n"


def _role(found: re.Match[str]) -> str:
    text = " ".join(found["text"].split())
    if found["role"] == "math":
        return f"${text}$"
    name = text.removeprefix("~")
    shown = name.rpartition(".")[2] if text.startswith("~") else name
    if not name.startswith("jaxmuscle."):
        return f"`{shown}`"
    # A link where the site has a page of it, plain code elsewhere.
    return f'<autoref optional identifier="{name}"><code>{shown}</code></autoref>'
