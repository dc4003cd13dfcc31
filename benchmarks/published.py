"""Every readable published number of the three source systems beside ours: one table.

[T] by `tondu.py`, [H] by `jet_pipe.py`, [W] by `hysteresis.py`, the controllers of all three by
`closed_loop.py`: their rows, with source and tolerance. Counted is what a source prints, from the experiment
that it describes. Checks of our own, statements without a number, and numbers under another reading of the
source than the declared one are shown and not counted.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator

import closed_loop
import hysteresis
import jax
import jet_pipe
import tondu
from published_rows import Row, printed


def rows() -> Iterator[Row]:
    """All rows, system by system."""
    for table in (tondu, jet_pipe, hysteresis, closed_loop):
        yield from table.rows()
        jax.clear_caches()


if __name__ == "__main__":
    sys.exit(printed("published", __doc__, rows))
