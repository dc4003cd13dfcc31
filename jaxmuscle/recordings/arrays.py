"""A recording from arrays in memory, for a rig of the package or one of the user's own."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import ArrayLike

from jaxmuscle.actuators.base import AbstractActuator
from jaxmuscle.errors import InputError, nearest
from jaxmuscle.parameters import get
from jaxmuscle.recordings import schema
from jaxmuscle.recordings.card import Card
from jaxmuscle.recordings.plausible import check_machine
from jaxmuscle.recordings.quantity import ColumnSpec, Quantity
from jaxmuscle.recordings.recording import Recording
from jaxmuscle.recordings.schema import Need


def recording(
    actuator: AbstractActuator,
    columns: Mapping[str, ArrayLike],
    step: float,
    *,
    noise: Mapping[str, float] | None = None,
    horizon: float | None = None,
    breaks: Sequence[int] = (),
    name: str = "recording",
) -> Recording:
    """What a bench measured, from arrays in SI units (pressures absolute) on a uniform clock.

    Its card says what `actuator` says: every quantity is known. What a fit is to move is then named with
    ``free=``. The class of the actuator need not be one of the package.

    Args:
        actuator: the machine; its class says which columns there have to be.
        columns: command(s) and measured quantities → samples, all of one length; readings may be NaN.
        step: sampling step [s].
        noise: column → standard deviation of its sensor (SI); found in the data where not given.
        horizon: length of the windows of prediction [s]; whole runs when `None`.
        breaks: rows at which a new run begins, with everything that is not measured at rest.
        name: what results call it.

    Raises:
        InputError: columns that are missing, unknown or of unequal length; a step, noise, horizon or break
            that cannot be; samples that cannot be of this machine (a reversed sign, a wrong unit).
    """
    rig = type(actuator)
    needs = {key: need for key, need in schema.columns(rig).items() if key != "time"}
    for where, given in (("columns", columns), ("noise", noise or {})):
        for key in given:
            if key not in needs:
                raise InputError(f"{where}: unknown column {key!r}{nearest(key, needs)}")
    if missing := [key for key in needs if key not in columns]:
        raise InputError(f"columns: {', '.join(missing)} missing; rig {rig.rig!r} has {', '.join(needs)}")
    arrays = {key: np.asarray(columns[key], dtype=float) for key in needs}
    shapes = {key: values.shape for key, values in arrays.items()}
    if len(set(shapes.values())) > 1 or len(next(iter(shapes.values()))) != 1:
        raise InputError(f"columns: expected one axis of samples, of one length for all; got shapes {shapes}")
    rows = len(next(iter(arrays.values())))
    if not 0 < step < math.inf:
        raise InputError(f"step: expected the time between two samples, above zero [s]; got {step}")
    for key, level in (noise or {}).items():
        if not 0 < level < math.inf:
            raise InputError(f"noise[{key!r}]: expected a standard deviation above zero (SI); got {level}")
    if horizon is not None and not step <= horizon <= rows * step:
        raise InputError(
            f"horizon: expected a time from one step, {step:g} s, to the whole recording, {rows * step:g} s; "
            f"got {horizon:g}"
        )
    if wrong := [row for row in breaks if not 0 < row < rows]:
        raise InputError(f"breaks: expected rows between 1 and {rows - 1}; got {wrong}")
    card = _card(actuator, needs, dict(noise or {}), horizon)
    if all(np.isfinite(values).any() for values in arrays.values()):
        check_machine(f"recording {name!r}", rig, card, arrays, float(step))
    clock = float(step) * np.arange(rows, dtype=np.float64)
    ordered = tuple(sorted({int(row) for row in breaks}))
    return Recording(name, None, None, card, clock, float(step), arrays, ordered)


def _card(
    actuator: AbstractActuator, needs: Mapping[str, Need], noise: dict[str, float], horizon: float | None
) -> Card:
    """The card of a machine whose every quantity is known."""
    columns = {
        key: ColumnSpec(key, need.unit, "absolute" if need.referenced else None)
        for key, need in {schema.CLOCK.name: Need(schema.CLOCK.unit, "clock"), **needs}.items()
    }
    known = {}
    for key, need in schema.quantities(type(actuator)).items():
        value = float(get(actuator, actuator.quantities[key]))
        known[key] = Quantity(value, None, need.unit, "absolute" if need.referenced else None)
    return Card(actuator.rig, columns, known, {}, noise=noise, horizon=horizon)
