"""An elbow made of relays follows a sine under a PID, alone and with models inside as in [W] (7)."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import equinox as eqx
import hysteresis_loops as loops
import jax.numpy as jnp
import numpy as np
from hysteresis_loops import Series
from published_rows import OWN, Row, aside, assuming, at_most

from jaxmuscle.control import IntegralInversePID
from jaxmuscle.control.pid import Controlling
from jaxmuscle.hysteresis import IntegralInverse, respond
from jaxmuscle.hysteresis.compensation import Inverting

PUBLISHED = {"PID": 1.9912, "classical": 1.4013, "modified": 1.0171}
"""Root mean square errors in the simulations of [W], section 4.1 [deg]."""
STEP = 0.05
SECONDS = 62.5
INTEGRAL_TIME = 0.5
INVERSE_GAIN = 0.5
"""[bar/(deg s)]: with 15 degrees a bar the model's own error decays in 0.13 s."""


def reference() -> Series:
    """[W] 4.1: y_d = 45 sin(π t/25 - π/2) + 45 [deg]."""
    t = np.arange(round(SECONDS / STEP)) * STEP
    return 45 * np.sin(np.pi * t / 25 - np.pi / 2) + 45


@eqx.filter_jit
def _update(controller: Any, state: Any, wanted: Any, measured: Any) -> Any:
    return controller.update(state, wanted, measured, STEP)


def tracking_error(controller: IntegralInversePID, state: Controlling) -> float:
    """Root mean square error [deg] over the last period of 50 s."""
    plant = loops.Plant()
    plant.move(np.array([0.0, 6.0, 0.0]))
    wanted, command, found = reference(), 0.0, []
    for target in wanted:
        angle = plant.move(np.array([command]))[-1]
        found.append(angle)
        state, u = _update(controller, state, jnp.asarray(target), jnp.asarray(angle))
        command = float(np.clip(u, 0.0, 6.0))
    late = slice(len(wanted) // 5, None)
    return float(np.sqrt(np.mean((np.array(found) - wanted)[late] ** 2)))


def controller(model: Any, proportional: float) -> tuple[IntegralInversePID, Controlling]:
    """The controller, its model brought to where the elbow is: 0 bar after one round."""
    kind: Any = IntegralInversePID
    ahead: Any = IntegralInverse
    zero = jnp.zeros(())
    if model is None:
        return kind(None, proportional, INTEGRAL_TIME, 0.0), Controlling(Inverting(zero, None), zero, zero)
    memory = respond(model, [0.0, 6.0, 0.0])[0]
    inverse = ahead(model, INVERSE_GAIN)
    return (
        kind(inverse, proportional, INTEGRAL_TIME, 0.0),
        Controlling(Inverting(zero, memory), zero, zero),
    )


def gain_with(error: float) -> float:
    """The gain K_p [bar/deg] with which the PID alone leaves a given error, by bisection of its logarithm."""
    low, high = np.log(1e-3), np.log(0.1)
    for _ in range(8):
        middle = 0.5 * (low + high)
        weak = tracking_error(*controller(None, float(np.exp(middle)))) > error
        low, high = (middle, high) if weak else (low, middle)
    return float(np.exp(0.5 * (low + high)))


def rows() -> Iterator[Row]:
    """The PID is as good as that of [W]; what its models add to it is what counts."""
    loop = loops.loops()[-1]
    fits = loops.fits(loop)
    gain = gain_with(PUBLISHED["PID"])
    models = {"PID": None, "classical": fits["classical, free weights"], "modified": fits["modified"]}
    found = {name: tracking_error(*controller(model, gain)) for name, model in models.items()}
    print(f"\ntracking of [W] 4.1 by an elbow of relays, K_p = {gain:.4f} bar/deg: rms error [deg]")
    for name, error in found.items():
        print(f"{name:14s} {error:8.3f}   published, another elbow {PUBLISHED[name]:.3f}")
    for name in ("classical", "modified"):
        goal, ours = PUBLISHED[name] / PUBLISHED["PID"], found[name] / found["PID"]
        entry = at_most("[W] 4.1", f"tracking: {name} model over PID alone", f"{goal:.4g}", ours, "",
                        "another elbow than that of [W]")  # fmt: skip
        chosen = f"K_p = {gain:.4f} bar/deg, at which the PID alone is as good as that of [W]"
        yield {**assuming(aside(entry, OWN), chosen), "all": found}
