"""An objective of a robot: how far its tip is from where its joints are told to bring it."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array

from jaxmuscle.control.loop import ClosedLoop
from jaxmuscle.control.sliding_mode import target_of
from jaxmuscle.errors import InputError
from jaxmuscle.robot import Arm, tip


def tip_error(arm: Arm, error: float, variation: float | None = None) -> Callable[[ClosedLoop, Any], Array]:
    r"""An objective of :func:`jaxmuscle.tune` for a robot whose tip follows a line.

    .. math:: c = \frac{\overline{|p(q) - p(q_d)|^2}}{e^2} + \frac{\overline{\dot c^2}}{v^2}

    p the position of the tip at angles q of the joints and at those q_d that are wanted, the bars means over
    the samples (and the commands).

    Args:
        arm: of the robot, ``robot.arm``.
        error: root mean square distance e that costs one [m].
        variation: root mean square rate v of the commands that costs one [Pa/s]; free when `None`.

    Raises:
        InputError: a size that is not above zero.
    """
    for name, size in (("error", error), ("variation", variation)):
        if size is not None and not 0 < size < float("inf"):
            raise InputError(f"tip_error: {name}: expected a size above zero (SI); got {size!r}")
    arm = jax.tree.map(jnp.asarray, arm)

    def tip_error_of(run: ClosedLoop, reference: Any) -> Array:
        off = tip(arm, run.readings["angle"]) - tip(arm, target_of(reference))
        parts = [(off / (error * jnp.sqrt(len(off)))).ravel()]
        if variation is not None:
            rate = jnp.diff(run.commands, axis=0) / (run.time[1] - run.time[0])
            parts.append((rate / (variation * jnp.sqrt(rate.size))).ravel())
        return jnp.concatenate(parts)

    return tip_error_of
