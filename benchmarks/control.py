"""Is tuning through the loop right, quick, and worth it on a plant that the model is not?

Derivatives beside finite differences; evaluations and seconds beside methods without gradients; a thousand
loops with their gradient beside CasADi and do-mpc; gains tuned on models of a joint and of a lift, with and
without the effect that their cards do not name, on the oracles of these rigs; what naming it is worth. No
source publishes any of this: all rows are goals of our own.

    python benchmarks/control.py [--only gradients speed race joint lift worth] [--json]
"""

from __future__ import annotations

import functools
import sys

from control_gradients import gradient_rows
from control_loops import JOINT, LIFT
from control_plant import plant_rows
from control_race import race_rows
from control_speed import speed_rows
from control_worth import worth_rows
from published_rows import Sections, printed

SECTIONS: Sections = {
    "gradients": gradient_rows,
    "speed": speed_rows,
    "race": race_rows,
    "joint": functools.partial(plant_rows, JOINT),
    "lift": functools.partial(plant_rows, LIFT),
    "worth": worth_rows,
}

if __name__ == "__main__":
    sys.exit(printed("control", __doc__, SECTIONS))
