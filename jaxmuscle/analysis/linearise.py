"""The linear model of any machine about an operating point, by automatic differentiation."""

from __future__ import annotations

import jax
import jax.numpy as jnp

from jaxmuscle.actuators.base import AbstractActuator
from jaxmuscle.analysis.equilibrium import OperatingPoint
from jaxmuscle.analysis.linear import LinearModel


def linearise(actuator: AbstractActuator, point: OperatingPoint) -> LinearModel:
    """A, B, C, D of `actuator` about `point`: exact derivatives of its vector field and readings.

    Inputs are the rig's commands, outputs its readings. States that the point holds stay held; effects with
    a memory are taken with the branch they are on, so that inside a play the part behind it does not move;
    a delay counts for nothing. May be vmapped together with :func:`equilibrium`.
    """
    here = point.situation

    def rates(x, u):
        return here.rates(actuator, x, u)

    def readings(x, u):
        return here.readings(actuator, x, u)

    def by_command(f):
        return jax.jacfwd(f, argnums=1)(point.state, point.command).reshape(-1, len(actuator.commands))

    outputs = tuple(name for names in actuator.outputs.values() for name in names)
    return LinearModel(
        a=jax.jacfwd(rates)(point.state, point.command),
        b=by_command(rates),
        c=jnp.atleast_2d(jax.jacfwd(readings)(point.state, point.command)),
        d=by_command(readings),
        states=here.names,
        inputs=actuator.commands,
        outputs=outputs,
    )
