"""Tuning of controllers by gradient descent through the whole closed loop, over scenarios.

A machine, a controller with gains to begin with, scenarios to tune on and others for the last word::

    import jaxmuscle as jm
    import numpy as np

    joint, times = jm.robot.robot_joint(inertia=0.64), np.arange(0, 3, 2e-3)
    pid = jm.control.PID(proportional=1e5, integral=1e5, derivative=1e4)
    rest = {"pressure": np.full(2, 351e3)}
    payloads = {"inertia": [0.5, 0.64, 0.9]}
    practice = jm.tuning.grid(0.3 * np.sin(2 * times), times, payloads, start=rest, noise={"angle": 2e-4})
    unseen = jm.tuning.grid(0.2 * np.sin(3 * times), times, {"inertia": [0.55, 1.0]}, start=rest)
    tuned = jm.tune(joint, pid, practice, {"tracking": np.deg2rad(1), "variation": 3e6}, held_out=unseen)
    print(tuned)
    tuned.save("gains.toml")

`tuned.controller` is the controller with its new gains. Parameters of a machine that was fitted vary as the
fit leaves them open with ``jm.tuning.drawn(references, times, jm.tuning.sample(fit, 20))``. Where not the
gains but the reference is free, :func:`optimal_reference` finds the one that costs least within limits.
"""

from jaxmuscle.tuning.cost_terms import TERMS
from jaxmuscle.tuning.optimal_reference import OptimalReference, optimal_reference
from jaxmuscle.tuning.scenario_costs import Gain, Judged
from jaxmuscle.tuning.scenarios import Scenario, drawn, grid, sample
from jaxmuscle.tuning.tip_error import tip_error
from jaxmuscle.tuning.tune import tune
from jaxmuscle.tuning.tuning_result import Tuning

__all__ = [
    "TERMS",
    "Gain",
    "Judged",
    "OptimalReference",
    "Scenario",
    "Tuning",
    "drawn",
    "grid",
    "optimal_reference",
    "sample",
    "tip_error",
    "tune",
]
