"""A diagnosis printed."""

import pytest
from report.fake import diagnosis


@pytest.mark.parametrize("verdict", ["effects found", "complete", "unexplained"])
def test_printed(verdict):
    """The verdict, what was added, and the errors on unseen data: not the arrays behind them."""
    lines = repr(diagnosis(verdict)).split("\n")
    found = verdict == "effects found"
    assert lines[0] == f"lift: {verdict}" and len(lines) == 1 + found + 1 + 2
    assert (lines[1] == "load_friction: force 16.2 ± 0.4 N") == found
    assert lines[-3].split() == ["error", "on", "unseen", "data", "before", "after", "sensor", "noise"]
    assert {line.split()[0] for line in lines[-2:]} == {"pressure", "position"}
