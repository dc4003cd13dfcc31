"""Models of hysteresis with which its properties are tested, and what a way of the input makes of them."""

import jax
import jax.numpy as jnp
import numpy as np
from oracles.bench import built
from oracles.relays import way

from jaxmuscle.hysteresis import (
    Envelope,
    ExponentialPrandtlIshlinskii,
    FrameRule,
    GeneralizedPrandtlIshlinskii,
    ModifiedPrandtlIshlinskii,
    PrandtlIshlinskii,
    respond,
)

CLASSICAL = built(PrandtlIshlinskii, 0.8, [0.5, 0.3, -0.2, 0.4], [0.05, 0.2, 0.45, 0.7], 0.3)
EXPONENTIAL = built(ExponentialPrandtlIshlinskii, 0.4, 2.0, 3.0, 0.1)
RISING, FALLING = built(Envelope, 1.6, 0.9, -0.3, 0.1), built(Envelope, 1.4, 1.1, 0.1, 0.2)
MODIFIED = built(ModifiedPrandtlIshlinskii, RISING, FALLING, 1.5, 2.0, 0.12, 0.3, 0.1, 8)
GENERALIZED = built(
    GeneralizedPrandtlIshlinskii, RISING, FALLING, [0.6, 0.4, 0.7], [0.05, 0.3, 0.6], 0.2, -0.4
)
MODELS = {
    "classical": CLASSICAL,
    "exponential": EXPONENTIAL,
    "modified": MODIFIED,
    "generalized": GENERALIZED,
}


def frame_rule(points=121):
    """Frame's rule for a saturating major loop that closes at -1.5 and 1.5."""
    u = np.linspace(-1.5, 1.5, points)
    width = 0.15 * (1 - (u / 1.5) ** 2)
    return built(FrameRule, u, np.tanh(0.8 * u) - width, np.tanh(0.8 * u) + width)


@jax.jit
def followed(model, values, memory):
    return respond(model, values, memory)


def outputs(model, *corners, samples=40, memory=None, spacing=1.0):
    """Memory at the end and outputs along straight lines; `spacing` other than 1 changes the pace."""
    values = way(corners, samples)
    if spacing != 1.0:
        share = np.linspace(0, 1, samples + 1)[1:] ** spacing
        legs = [a + (b - a) * share for a, b in zip(corners[:-1], corners[1:], strict=True)]
        values = np.concatenate([[corners[0]], *legs])
    memory, found = followed(model, jnp.asarray(values), model.rest() if memory is None else memory)
    return memory, np.asarray(found)
