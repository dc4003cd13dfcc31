"""Names of the code in plain words."""

import pytest

from jaxmuscle.report.words import listed, meaning


@pytest.mark.parametrize(
    ("docstring", "text"),
    [
        (r"Viscous damping: :math:`ΔF = -d\,v`; v in m/s." + "\n\nMore.", "Viscous damping."),
        ("The command acts `delay` seconds late.", "The command acts delay seconds late."),
        ("\n    Begins on the second line.\n    Goes on.", "Begins on the second line."),
        (None, ""),
    ],
)
def test_meaning_is_the_first_line_without_markup(docstring: str | None, text: str) -> None:
    assert meaning(docstring) == text


@pytest.mark.parametrize(
    ("items", "text"),
    [
        (["a"], "a"),
        (["a", "b"], "a and b"),
        (["a", "b", "c", "d"], "a, b, c and d"),
        (["a", "b", "c", "d", "e"], "a, b, c and 2 others"),
    ],
)
def test_long_lists_are_counted(items: list[str], text: str) -> None:
    assert listed(items) == text
