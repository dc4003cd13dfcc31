"""The linear model of any machine about an operating point, by automatic differentiation."""

from __future__ import annotations

import equinox as eqx
import jax
import jax.core
import jax.numpy as jnp
from jaxtyping import Array

from jaxmuscle.actuators.base import AbstractActuator
from jaxmuscle.analysis.equilibrium import OperatingPoint
from jaxmuscle.analysis.linear import LinearModel
from jaxmuscle.errors import InputError


def linearise(actuator: AbstractActuator, point: OperatingPoint) -> LinearModel:
    """A, B, C, D of `actuator` about `point`: exact derivatives of its vector field and readings.

    For the jet-pipe actuator what [H] 4.3 to 4.33 derive by hand.

    Inputs are the rig's commands, outputs its readings. States that the point holds stay held; effects with
    a memory are taken with the branch they are on, so that inside a play the part behind it does not move;
    a delay counts for nothing; at a stop a state goes back to it with rate 1/τ, whatever the command
    (:meth:`Situation.rates`). May be vmapped together with :func:`equilibrium`: inside a transformation the
    model of a point that did not converge is NaN throughout, and its `converged` is false.

    Raises:
        InputError: the point did not converge, called outside of transformations.
    """
    if not isinstance(point.converged, jax.core.Tracer) and not bool(jnp.all(point.converged)):
        raise InputError(
            f"linearise: expected a machine at rest; rig {actuator.rig!r} comes to no rest under command "
            f"{point.command} from the states it was started from (point.converged is false). Give "
            "equilibrium another start, hold what rests at any value (the pressure behind a shut valve: "
            'hold=("pressure",)), or ask for an output within reach'
        )
    return _linearised(actuator, point)


@eqx.filter_jit
def _linearised(actuator: AbstractActuator, point: OperatingPoint) -> LinearModel:
    """:func:`linearise`, compiled once for every kind of machine."""
    here = point.situation
    states = point.state.size

    def everything(both: Array) -> Array:
        x, u = both[:states], both[states:].reshape(point.command.shape)
        return jnp.concatenate([here.rates(actuator, x, u), here.readings(actuator, x, u)])

    slopes = jax.jacfwd(everything)(jnp.concatenate([point.state, point.command.ravel()]))
    slopes = jnp.where(point.converged, slopes, jnp.nan)
    return LinearModel(
        a=slopes[:states, :states],
        b=slopes[:states, states:],
        c=slopes[states:, :states],
        d=slopes[states:, states:],
        states=here.names,
        inputs=actuator.commands,
        outputs=tuple(name for names in actuator.outputs.values() for name in names),
        converged=point.converged,
    )
