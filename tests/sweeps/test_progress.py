"""What is shown of a sweep under way."""

import re

from rich.console import Console

from jaxmuscle.sweeps.sweep import _bar, shown


def test_a_line_each_tenth_on_standard_error(capsys):
    with shown(True, 1000) as tell:
        for _ in range(100):
            tell(10)
    told = capsys.readouterr()
    assert told.out == ""
    lines = told.err.splitlines()
    assert len(lines) == 10
    assert [int(line.split()[0]) for line in lines] == list(range(100, 1001, 100))
    assert re.fullmatch(r"1000 of 1000 points, 0 s left", lines[-1])


def test_one_line_for_one_block(capsys):
    with shown(True, 3) as tell:
        tell(3)
    assert capsys.readouterr().err == "3 of 3 points, 0 s left\n"


def test_nothing_unless_asked(capsys):
    with shown(False, 10) as tell:
        tell(10)
    assert capsys.readouterr() == ("", "")


def test_a_function_is_told_all(capsys):
    told = []
    with shown(lambda *now: told.append(now), 6) as tell:
        tell(4)
        tell(2)
    assert told == [(4, 6), (6, 6)]
    assert capsys.readouterr() == ("", "")


def test_a_bar_with_the_remaining_time_in_a_terminal():
    console = Console(force_terminal=True, width=80, record=True)
    for tell in _bar(console, 8):
        tell(8, 8)
    assert "8/8" in console.export_text()
