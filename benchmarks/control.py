"""Is tuning through the loop right, quick, and worth it on a plant that the model is not?

Derivatives beside finite differences; evaluations and seconds beside methods without gradients; gains tuned
on models of a joint, with and without the effect that its card does not name, on the oracle of the rig. No
source publishes any of this: all rows are goals of our own.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator

from control_gradients import gradient_rows
from control_plant import plant_rows
from control_race import race_rows
from published_rows import Row, printed


def rows() -> Iterator[Row]:
    """All rows."""
    for part in (gradient_rows, race_rows, plant_rows):
        yield from part()


if __name__ == "__main__":
    sys.exit(printed("control", __doc__, rows))
