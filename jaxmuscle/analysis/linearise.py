"""The linear model of any machine about an operating point, by automatic differentiation."""

from __future__ import annotations

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array

from jaxmuscle.actuators.base import AbstractActuator
from jaxmuscle.analysis.equilibrium import OperatingPoint
from jaxmuscle.analysis.linear import LinearModel


@eqx.filter_jit
def linearise(actuator: AbstractActuator, point: OperatingPoint) -> LinearModel:
    """A, B, C, D of `actuator` about `point`: exact derivatives of its vector field and readings.

    For the jet-pipe actuator what [H] 4.3 to 4.33 derive by hand.

    Inputs are the rig's commands, outputs its readings. States that the point holds stay held; effects with
    a memory are taken with the branch they are on, so that inside a play the part behind it does not move;
    a delay counts for nothing. May be vmapped together with :func:`equilibrium`.
    """
    here = point.situation

    states = point.state.size

    def everything(both: Array) -> Array:
        x, u = both[:states], both[states:].reshape(point.command.shape)
        return jnp.concatenate([here.rates(actuator, x, u), here.readings(actuator, x, u)])

    slopes = jax.jacfwd(everything)(jnp.concatenate([point.state, point.command.ravel()]))
    return LinearModel(
        a=slopes[:states, :states],
        b=slopes[:states, states:],
        c=slopes[states:, :states],
        d=slopes[states:, states:],
        states=here.names,
        inputs=actuator.commands,
        outputs=tuple(name for names in actuator.outputs.values() for name in names),
    )
