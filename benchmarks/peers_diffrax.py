"""Plain `diffrax.diffeqsolve`: the twelve states at once, fixed or controlled steps."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
from peers_model import CLOCK, COMMAND, HOLD, KNOTS, START, STEP, rates

SCALES = np.array([1.0, 1e5, 0.1, 0.1, *[0.1] * 8])
TRIED = (("fixed", 1), ("fixed", 2), ("fixed", 4), ("fixed", 8), ("controlled", 1e-4), ("controlled", 1e-5),
         ("controlled", 3e-6), ("controlled", 1e-6), ("controlled", 1e-7))  # fmt: skip
"""Steps a sample, or relative tolerance."""


def solver(kind: str, setting: float) -> Callable[[jax.Array], jax.Array]:
    """Parameters → position at the samples, compiled."""
    command = jnp.asarray(COMMAND)
    jumps = jnp.asarray(STEP * HOLD * np.arange(1, len(KNOTS)))

    def field(t: Any, z: Any, q: Any) -> Any:
        row = jnp.clip(jnp.floor(t / STEP * (1 + 1e-12)).astype(int), 0, len(command) - 1)
        own, plays = rates(list(z * SCALES), command[row], list(q), jnp)
        return jnp.stack([*own, *plays]) / SCALES

    if kind == "fixed":
        control: Any = diffrax.ConstantStepSize()
        first = STEP / setting
    else:
        inner = diffrax.PIDController(rtol=setting, atol=setting)
        control, first = diffrax.ClipStepSizeController(inner, jump_ts=jumps), None

    @jax.jit
    def run(q: jax.Array) -> jax.Array:
        found = diffrax.diffeqsolve(
            diffrax.ODETerm(field), diffrax.Tsit5() if kind != "fixed" else diffrax.Heun(), 0.0, CLOCK[-1],
            first, jnp.asarray(START / SCALES), q, saveat=diffrax.SaveAt(ts=jnp.asarray(CLOCK)),
            stepsize_controller=control, max_steps=100_000, throw=False,
        )  # fmt: skip
        assert found.ys is not None
        return found.ys[:, 2] * SCALES[2]

    return run
