"""What controllers have in common: checks of their numbers, rates from samples, integrals under limits."""

from __future__ import annotations

import dataclasses

import equinox as eqx
import jax.core
import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxmuscle.errors import InputError

Value = Float[Array, ""]


def check_signs(controller: eqx.Module) -> None:
    """Raise `InputError` for a gain, a time or a limit whose sign its declaration does not allow.

    Traced values pass: inside a transformation nothing is known of them.
    """
    for field in dataclasses.fields(controller):
        value = getattr(controller, field.name)
        positive, nonnegative = (field.metadata.get(key) for key in ("positive", "nonnegative"))
        if isinstance(value, jax.core.Tracer) or not (positive or nonnegative):
            continue
        if not bool((value > 0).all() if positive else (value >= 0).all()):
            least, meaning = "above zero" if positive else "zero or above", field.metadata["meaning"]
            raise InputError(
                f"{type(controller).__name__}: expected {field.name} ({meaning}) {least}; got {value}"
            )


def smoothed(before: Value, now: Value, time_constant: Value, step: float | Value) -> Value:
    """First-order low pass of samples, implicit: `before` [same unit as `now`] one `step` [s] later."""
    keep = time_constant / (time_constant + step)
    return keep * before + (1 - keep) * now


def integrated(before: Value, after: Value, output: Value, lowest: Value, highest: Value) -> Value:
    """An integral that waits where it would go the way on which the output is already beyond its limit."""
    waits = ((output > highest) & (after > before)) | ((output < lowest) & (after < before))
    return jnp.where(waits, before, after)
