"""How well are joints 0 and 3 of a real arm of eight muscles predicted 100 ms ahead, on unseen episodes?

The arm of the MPI for Intelligent Systems (Buechler et al. 2022), 100 Hz; pressures are normalised, commands
unusable (SOURCE.txt beside the data). The last fifth of the 3076 episodes is held out; parameters are fitted
to some of the others. A prediction starts from what was measured up to now (the velocity is the slope of a
parabola through the last samples). The goals are a linear model's from measured angles and pressures; it is
also fitted here, on the same instants: with the pressures up to now, and with those of the coming 100 ms.
The physical model is driven by the pressures of the coming 100 ms, as its rig's are; beside it, by pressures
that stay as they are now.

    python benchmarks/real_pam_arm.py [--json]
"""

from __future__ import annotations

import argparse
import json
import platform
import sys
import time
from typing import Any

import arm_data as data
import numpy as np
from arm_joint import ArmJoint

import jaxmuscle as jm
from jaxmuscle.components import McKibben

GOALS = {0: 0.0735, 3: 0.0606}
EPISODES = 80
"""Training episodes of the physical model."""
PRIORS = {
    "inertia": (0.1, 0.1),
    "initial_contraction": (0.12, 0.05),
    "end_factor": (1.2, 0.2),
    "gravity.hanging_angle": (0.0, 1.0),
    "bladder_stiffness.stiffness": (100.0, 300.0),
}
FREE = (
    *PRIORS,
    "gravity.torque",
    "load_friction.force",
    "load_damping.coefficient",
    "muscle_mismatch.ratio",
    "bladder_stiffness.threshold_pressure",
    "thread_friction.static_coefficient",
    "thread_friction.kinetic_coefficient",
)


def declared(joint: int) -> ArmJoint:
    """Nothing is known of the muscles: plausible ones."""
    effects = jm.effects
    plain: dict[str, Any] = {
        "load_friction": effects.LoadFriction(force=1.0),  # pyright: ignore
        "load_damping": effects.LoadDamping(coefficient=0.3),  # pyright: ignore
        "muscle_mismatch": effects.MuscleMismatch(),
        "gravity": effects.Gravity(hanging_angle=0.0),  # pyright: ignore
        "bladder_stiffness": effects.BladderStiffness(stiffness=100.0),  # pyright: ignore
        "thread_friction": effects.ThreadFriction(static_coefficient=0.02, kinetic_coefficient=0.02),  # pyright: ignore
    }
    muscle = McKibben(0.3, 0.01, np.deg2rad(23), 1.2)  # pyright: ignore
    # The wrist turns through ± 2 rad; a large sprocket would stretch its muscles beyond their braid.
    radius = 0.03 if joint == 0 else 0.015
    bare = ArmJoint(muscle=muscle, inertia=0.1, sprocket_radius=radius, initial_contraction=0.12)  # pyright: ignore
    return bare.with_effects(**plain)


def judged(arm: data.Arm, joint: int) -> dict[str, Any]:
    """Fit one joint and predict its held-out episodes: RMSE [rad] of each predictor."""
    machine, begin = declared(joint), time.perf_counter()
    some = np.linspace(0, arm.split - 1, EPISODES).astype(int)
    fit = jm.fit(
        machine, data.recording(arm, joint, some, machine), FREE, priors=PRIORS, loss="huber", steps=40
    )
    seconds = time.perf_counter() - begin
    test, train = data.instants(arm, joint, arm.held_out), data.instants(arm, joint, arm.training)
    errors = {
        "hold": data.rms(test.now - test.then),
        "linear, pressures up to now": data.linear(train, test, coming=False),
        "linear, pressures of the coming 100 ms": data.linear(train, test, coming=True),
        "physical, pressures as they are now": data.rms(
            data.ahead(fit.actuator, test, held=True) - test.then
        ),
        "physical, pressures of the coming 100 ms": data.rms(data.ahead(fit.actuator, test) - test.then),
    }
    return {"errors": errors, "fit_seconds": seconds, "notes": fit.notes(),
            "parameters": {n: [p.value, p.std if np.isfinite(p.std) else None, p.unit]
                           for n, p in fit.parameters.items()}}  # fmt: skip


def compared(joint: int, goal: float, name: str, found: dict[str, Any]) -> dict[str, Any]:
    """A row of the table: one physical predictor against the goal and the linear ones."""
    ours = found["errors"][name]
    better = [n for n, error in found["errors"].items() if n.startswith("linear") and error < ours]
    row = {"figure": f"joint {joint}, RMSE [rad]: {name}", "goal": goal, "ours": ours, "ok": ours < goal,
           "beaten_by": better, **found}  # fmt: skip
    linear = found["errors"]["linear, pressures up to now"]
    why = f"told no pressure of the coming 100 ms; a linear model so told has {linear:.4f} on these instants"
    return row if row["ok"] else {**row, "why": why}


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
        for name, error in found["errors"].items():
            print(f"  joint {joint}  {name:42s} {error:.4f}")
        rows += [compared(joint, goal, name, found) for name in found["errors"] if "physical" in name]
    for row in rows:
        print(
            f"{'ok  ' if row['ok'] else 'MISS'} {row['figure']:58s} {row['ours']:.4f}   below {row['goal']}"
        )
    if arguments.json:
        print(json.dumps({"benchmark": "real_pam_arm", "rows": rows,
                          "reached": sum(row["ok"] for row in rows), "of": len(rows),
                          "machine": platform.processor() or platform.machine(),
                          "seconds": time.perf_counter() - begin}))  # fmt: skip
    return 0


if __name__ == "__main__":
    sys.exit(main())
