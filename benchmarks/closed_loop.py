"""Do the controllers of the three sources do in closed loop what was published? On the package's own rigs.

Gains that no source prints are tuned here; each row whose outcome rests on such a number says so.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator

from closed_loop_elbow import elbow_rows
from closed_loop_force import force_rows
from closed_loop_joint import joint_rows
from closed_loop_pane import pane_rows
from closed_loop_robot import robot_rows
from published_rows import Row, printed

PARTS: tuple[Callable[[], Iterator[Row]], ...] = (joint_rows, robot_rows, pane_rows, force_rows, elbow_rows)


def rows() -> Iterator[Row]:
    """All rows."""
    for part in PARTS:
        yield from part()


if __name__ == "__main__":
    sys.exit(printed("closed_loop", __doc__, rows))
