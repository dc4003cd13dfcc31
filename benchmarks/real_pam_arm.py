"""How well are joints 0 and 3 of a real arm of eight muscles predicted 100 ms ahead, on unseen episodes?

The arm of the MPI for Intelligent Systems (Buechler et al. 2022), 100 Hz; pressures are normalised, commands
unusable (SOURCE.txt beside the data). The last fifth of the 3076 episodes is held out. Everything is chosen
on the others, within this run: sets of effects are fitted to episodes of the first three quarters of them, in
windows whose first velocity is told by the past or by both sides, and compared on the last quarter; the best
set, with these windows and a way to continue pressures, is fitted again to episodes of all of them; the
held-out episodes are looked at once, with that.

A prediction starts from what was measured up to now (`jaxmuscle.recordings.smoothing.rate_from_past`). The
goals are a linear model's from measured angles and pressures; it is also fitted here, on the same instants:
with the pressures up to now, and with those of the coming 100 ms. The physical model is judged by the
pressures up to now, and counted with these only; beside it stands, not counted, what it predicts when told
those of the coming 100 ms.

    python benchmarks/real_pam_arm.py [--json]
"""

from __future__ import annotations

import argparse
import dataclasses
import itertools
import json
import platform
import sys
import time
from collections.abc import Sequence
from typing import Any

import arm_data as data
import numpy as np
from arm_joint import ArmJoint
from measured_rows import arm_predictor
from published_rows import counts, finite, line

import jaxmuscle as jm
from jaxmuscle.components import McKibben
from jaxmuscle.recordings.card_sections import STATES_FROM

GOALS = {0: 0.0735, 3: 0.0606}
PRESENT, COMING = "physical, pressures up to now", "physical, pressures of the coming 100 ms"
EPISODES, FEWER = 80, 40
"""Episodes to which the chosen model, and to which every model that may be chosen, is fitted."""
FADES = (0.0, 0.02, 0.05, 0.1)
"""Time constants with which pressures may be continued [s]."""
MUSCLE = McKibben(0.3, 0.01, np.deg2rad(23), 1.2)  # pyright: ignore
RADIUS = {0: 0.03, 3: 0.015}
"""Of each joint [m]. The wrist turns through ± 2 rad; a large sprocket would stretch its muscles beyond their
braid."""
PRIORS = {
    "inertia": (0.1, 0.1),
    "initial_contraction": (0.12, 0.05),
    "end_factor": (1.2, 0.2),
    "gravity.hanging_angle": (0.0, 1.0),
    "bladder_stiffness.stiffness": (100.0, 300.0),
}
ALWAYS = ("inertia", "initial_contraction", "end_factor", "load_friction.force", "load_damping.coefficient",
          "muscle_mismatch.ratio")  # fmt: skip
GRAVITY = ("gravity.torque", "gravity.hanging_angle")
BLADDER = ("bladder_stiffness.stiffness", "bladder_stiffness.threshold_pressure")
THREADS = ("thread_friction.static_coefficient", "thread_friction.kinetic_coefficient")
SETS = {
    "friction, damping, unequal muscles": ALWAYS,
    "these and gravity": (*ALWAYS, *GRAVITY),
    "these, gravity and bladder": (*ALWAYS, *GRAVITY, *BLADDER),
    "these, bladder and thread friction": (*ALWAYS, *BLADDER, *THREADS),
    "these, gravity, bladder and thread friction": (*ALWAYS, *GRAVITY, *BLADDER, *THREADS),
}
"""What is free in each set; effects that are not in it are left out."""


@dataclasses.dataclass(frozen=True)
class Choice:
    """What is chosen on validation episodes: a set of effects, samples that tell the first velocity of a
    window, and the time over which pressures are continued [s].
    """

    effects: str
    state_from: str
    fade: float

    def __str__(self) -> str:
        """In words."""
        return f"{self.effects}; velocities from {self.state_from}; pressures fade over {self.fade:g} s"


def declared(joint: int, free: Sequence[str]) -> ArmJoint:
    """Nothing is known of the muscles: plausible ones, with the effects of which something is free."""
    effects = jm.effects
    plain: dict[str, Any] = {
        "load_friction": effects.LoadFriction(force=1.0),  # pyright: ignore
        "load_damping": effects.LoadDamping(coefficient=0.3),  # pyright: ignore
        "muscle_mismatch": effects.MuscleMismatch(),
        "gravity": effects.Gravity(hanging_angle=0.0),  # pyright: ignore
        "bladder_stiffness": effects.BladderStiffness(stiffness=100.0),  # pyright: ignore
        "thread_friction": effects.ThreadFriction(static_coefficient=0.02, kinetic_coefficient=0.02),  # pyright: ignore
    }
    bare = ArmJoint(muscle=MUSCLE, inertia=0.1, sprocket_radius=RADIUS[joint], initial_contraction=0.12)  # pyright: ignore
    used = {name for name in plain if any(path.startswith(f"{name}.") for path in free)}
    return bare.with_effects(**{name: effect for name, effect in plain.items() if name in used})


def fitted(
    arm: data.Arm, joint: int, free: Sequence[str], state_from: str, last: int, count: int
) -> jm.FitResult:
    """A fit of one joint to `count` episodes, evenly spread from the first one to before the `last`."""
    machine, some = declared(joint, free), np.linspace(0, last - 1, count).astype(int)
    priors = {name: prior for name, prior in PRIORS.items() if name in free}
    recorded = data.recording(arm, joint, some, machine, state_from=state_from)
    return jm.fit(machine, recorded, free, priors=priors, loss="huber", steps=40)


def chosen(arm: data.Arm, joint: int) -> tuple[Choice, dict[str, float]]:
    """What predicts the validation episodes best, and the errors there of all that was tried."""
    unseen, errors = data.instants(arm, joint, arm.validation), {}
    for (name, free), state_from in itertools.product(SETS.items(), STATES_FROM):
        machine = fitted(arm, joint, free, state_from, arm.validation.start, FEWER).actuator
        for fade in FADES:
            error = data.rms(data.ahead(machine, unseen, fade=fade) - unseen.then)
            errors[Choice(name, state_from, fade)] = error
    return min(errors, key=lambda choice: errors[choice]), {str(choice): e for choice, e in errors.items()}


def judged(arm: data.Arm, joint: int) -> dict[str, Any]:
    """Choose, fit, and predict the held-out episodes: RMSE [rad] of each predictor."""
    begin = time.perf_counter()
    choice, validation = chosen(arm, joint)
    fit = fitted(arm, joint, SETS[choice.effects], choice.state_from, arm.split, EPISODES)
    seconds = time.perf_counter() - begin
    test, train = data.instants(arm, joint, arm.held_out), data.instants(arm, joint, arm.training)
    errors = {
        "hold": data.rms(test.now - test.then),
        "linear, pressures up to now": data.linear(train, test, coming=False),
        "linear, pressures of the coming 100 ms": data.linear(train, test, coming=True),
        PRESENT: data.rms(data.ahead(fit.actuator, test, fade=choice.fade) - test.then),
        COMING: data.rms(data.ahead(fit.actuator, test) - test.then),
    }
    return {"errors": errors, "chosen": str(choice), "validation": validation, "seconds": seconds,
            "notes": fit.notes(),
            "parameters": {n: [p.value, p.std if np.isfinite(p.std) else None, p.unit]
                           for n, p in fit.parameters.items()}}  # fmt: skip


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--json", action="store_true", help="end with one line of JSON")
    arguments, begin, rows = parser.parse_args(), time.perf_counter(), []
    arm = data.load()
    if arm is None:
        print("the measured data are not here: name their folder in JAXMUSCLE_DATA", file=sys.stderr)
        return 2
    for joint, goal in GOALS.items():
        found = judged(arm, joint)
        print(f"  joint {joint}: chosen on validation episodes: {found['chosen']}")
        for name, error in found["validation"].items():
            print(f"    validation  {name:104s} {error:.4f}")
        for name, error in found["errors"].items():
            print(f"  joint {joint}  {name:42s} {error:.4f}")
        for name in (PRESENT, COMING):
            entry = arm_predictor(joint, goal, found["errors"], name, coming=name == COMING)
            rows.append({**entry, **found})
    for entry in rows:
        print(line(entry))
    counted = counts(rows)
    print(f"{counted['reached']} of {counted['of']}")
    if arguments.json:
        table = {"benchmark": "real_pam_arm", "rows": rows, **counted,
                 "machine": platform.processor() or platform.machine(),
                 "seconds": time.perf_counter() - begin}  # fmt: skip
        print(json.dumps(finite(table), allow_nan=False))
    return 0


if __name__ == "__main__":
    sys.exit(main())
