"""Hooks of MkDocs: pages generated from the package, formulas rendered."""

from __future__ import annotations

from typing import Any

from blind_figures import with_blind_figures
from card_reference import card_reference
from command_reference import command_reference
from effect_reference import effect_reference
from equations_page import equations_page
from formulas import with_mathml
from mkdocs.structure.files import File, Files
from python_reference import python_reference
from thresholds import with_thresholds


def on_config(config: Any) -> Any:
    """Name the generated pages of the public packages in the navigation."""
    pages = [{title: f"reference/python/{name}"} for name, (title, _) in python_reference().items()]
    (reference,) = (section["Reference"] for section in config.nav if "Reference" in section)
    reference[-1]["Python"] = pages
    return config


def on_files(files: Files, config: Any) -> Files:
    """Add what is generated from the code to what is written."""
    written = {
        "explanation/equations.md": equations_page(),
        "reference/cards.md": card_reference(),
        "reference/effects.md": effect_reference(),
        "reference/commands.md": command_reference(),
    }
    written |= {f"reference/python/{name}": page for name, (_, page) in python_reference().items()}
    for place, content in written.items():
        files.append(File.generated(config, place, content=content))
    return files


def on_page_markdown(markdown: str, **_: Any) -> str:
    """Fill in the thresholds of a diagnosis and how it did on recordings that it had not seen."""
    return with_blind_figures(with_thresholds(markdown))


def on_page_content(html: str, **_: Any) -> str:
    """Render the formulas."""
    return with_mathml(html)
