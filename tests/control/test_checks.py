"""Controllers refuse numbers of the wrong sign, and only those."""

import dataclasses

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from oracles.bench import built

from jaxmuscle import control
from jaxmuscle.errors import InputError

ONE, PAIR = jnp.ones(()), jnp.ones(2)
GOOD = {
    control.FuzzyPID: (0.3, 2.0, 1e5, 1e5),
    control.IntegralInversePID: (None, 0.1, 0.5, 0.0),
    control.ProportionalForce: (),
    control.ScheduledPID: (None, np.array([45.0]), *(np.ones(2),) * 3),
    control.JointModel: (6.0, 60.0, 5e-4),
    control.SlidingMode: (built(control.JointModel, 6.0, 60.0, 5e-4), 8.0),
}
FIELDS = [
    (kind, field.name, "positive" if field.metadata["positive"] else "nonnegative")
    for kind in GOOD
    for field in dataclasses.fields(kind)
    if field.metadata.get("positive") or field.metadata.get("nonnegative")
]


def with_one(kind, name, value):
    names = [field.name for field in dataclasses.fields(kind)]
    given = dict(zip(names, GOOD[kind], strict=False))
    return kind(**{**given, name: value})


def shaped(kind, name, value):
    return np.full(np.shape(getattr(built(kind, *GOOD[kind]), name)), value)


def test_every_controller_is_here():
    controllers = {
        thing for thing in vars(control).values() if inspectable(thing) and hasattr(thing, "__check_init__")
    }
    assert controllers - {control.StaticCurve} == set(GOOD)


def inspectable(thing):
    return isinstance(thing, type) and issubclass(thing, eqx.Module)


@pytest.mark.parametrize(("kind", "name", "sign"), FIELDS, ids=[f"{k.__name__}.{n}" for k, n, _ in FIELDS])
def test_wrong_signs_are_refused(kind, name, sign):
    with pytest.raises(InputError, match=rf"{kind.__name__}: expected {name} .* got"):
        with_one(kind, name, shaped(kind, name, -1.0))
    with pytest.raises(InputError, match=name):
        with_one(kind, name, shaped(kind, name, np.nan))
    if sign == "positive":
        with pytest.raises(InputError, match="above zero"):
            with_one(kind, name, shaped(kind, name, 0.0))
    else:
        with_one(kind, name, shaped(kind, name, 0.0))


def test_gains_and_limits_are_among_what_is_checked():
    checked = {(kind.__name__, name) for kind, name, _ in FIELDS}
    assert {("SlidingMode", "limit"), ("ProportionalForce", "gain"), ("IntegralInversePID", "proportional"),
            ("ScheduledPID", "proportional"), ("FuzzyPID", "limit")} <= checked  # fmt: skip


def test_traced_numbers_pass():
    bandwidth = jax.jit(lambda gain: control.ProportionalForce(gain).bandwidth(ONE, ONE))
    assert float(bandwidth(-0.5)) == 0.5
