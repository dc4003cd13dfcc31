"""Recording from arrays in memory, with the card of an actuator whose every quantity is known."""

from __future__ import annotations

import dataclasses
import math
import warnings
from collections.abc import Mapping, Sequence

import numpy as np
import pandas as pd
import xarray as xr
from jaxtyping import ArrayLike

from jaxmuscle.actuators.actuator import AbstractActuator
from jaxmuscle.errors import InputError, Problems, nearest
from jaxmuscle.parameter_names import EFFECTS, resolve, spelled
from jaxmuscle.parameters import get, known_names
from jaxmuscle.recordings import schema
from jaxmuscle.recordings.card import Card
from jaxmuscle.recordings.card_sections import BOTH, check_state_from
from jaxmuscle.recordings.data_sheets import sheet_quantities
from jaxmuscle.recordings.plausibility import check_machine
from jaxmuscle.recordings.recording import Recording
from jaxmuscle.recordings.row_selection import LongRecording, RowRequest, request_of, selected, stretch_of
from jaxmuscle.recordings.schema import ColumnSpec, Need, Quantity
from jaxmuscle.units import Series

Columns = Mapping[str, ArrayLike] | pd.DataFrame | xr.Dataset


def recording(
    actuator: AbstractActuator,
    columns: Columns,
    step: float,
    *,
    noise: Mapping[str, float] | None = None,
    horizon: float | None = None,
    state_from: str = BOTH,
    breaks: Sequence[int] = (),
    name: str = "recording",
    uncertain: Mapping[str, float] | None = None,
    stretch: str | Sequence[float] | None = None,
    every: int | None = None,
    muscle: str | None = None,
    valve: str | None = None,
) -> Recording:
    """What a bench measured, from arrays in SI units (pressures absolute) on a uniform clock.

    Its card says what `actuator` says: every quantity is known but those of `uncertain`, which a diagnosis
    and a fit move; a fit also moves what ``free=`` names. The class of the actuator need not be one of the
    package. Effects of the actuator stand in no card: a diagnosis begins without them.

    Args:
        actuator: the machine; its class says which columns there have to be.
        columns: command(s) and measured quantities → samples, all of one length; readings may be NaN. A
            DataFrame or Dataset of such columns too; one in other units goes with a card to
            :func:`jaxmuscle.read`.
        step: sampling step [s].
        noise: column → standard deviation of its sensor (SI); found in the data where not given.
        horizon: length of the windows of prediction [s]; whole runs when `None`.
        state_from: ``"past"`` where windows shall begin with the state that samples up to then tell, as of
            :class:`~jaxmuscle.recordings.card.Card`.
        breaks: rows at which a new run begins, with everything that is not measured at rest.
        name: what results call it.
        uncertain: quantity of the card, by any of its names → standard deviation of what is known of it (SI).
        stretch, every: which rows to take, as of :func:`jaxmuscle.read`; what is taken of arrays of more
            than :data:`~jaxmuscle.recordings.row_selection.MOST_ROWS` rows is told by a warning.
        muscle, valve: type, such as ``"Festo DMSP-20"``, whose data sheet says how well the quantities of
            this part are known, where `uncertain` does not; the values are the actuator's.
            :func:`jaxmuscle.recordings.data_sheet` gives those of the data sheet.

    Raises:
        InputError: columns that are missing, unknown or of unequal length; a step, noise, horizon,
            `state_from` or break that cannot be; samples that cannot be of this machine (a reversed sign, a
            wrong unit); a type that has no data sheet, or whose part the machine does not have.
    """
    rig = type(actuator)
    needs = {key: need for key, need in schema.columns(rig).items() if key != "time"}
    _check_names(needs, columns, noise or {}, uncertain or {})
    arrays = _equally_long(rig, columns, needs)
    rows = len(next(iter(arrays.values())))
    _check_numbers(rows, step, noise or {}, horizon, breaks)
    parts = {part: kind for part, kind in (("muscle", muscle), ("valve", valve)) if kind is not None}
    card = _card(actuator, needs, dict(noise or {}), horizon, parts)
    card = dataclasses.replace(card, state_from=check_state_from(state_from))
    unsure = {**_unsure_by_data_sheet(rig, parts), **_deviations(actuator, uncertain or {})}
    card = _unsure_of(card, unsure)
    if all(np.isfinite(values).any() for values in arrays.values()):
        check_machine(f"recording {name!r}", rig, card, arrays, float(step))
    clock = float(step) * np.arange(rows, dtype=np.float64)
    ordered = tuple(sorted({int(row) for row in breaks}))
    whole = Recording(name, None, None, card, clock, float(step), arrays, ordered)
    taken = _rows_taken(whole, rig, request_of(stretch, every))
    if horizon is not None and not taken.step <= horizon <= len(taken) * taken.step:
        raise InputError(
            f"horizon: expected a time from one step, {taken.step:g} s, to all that is taken, "
            f"{len(taken) * taken.step:g} s; got {horizon:g}. {taken.left_out}"
        )
    return taken


def _check_names(needs: Mapping[str, Need], columns: object, noise: object, uncertain: object) -> None:
    """Raise `InputError` for what is no mapping, and for columns that the rig does not have."""
    for where, given in (("columns", columns), ("noise", noise), ("uncertain", uncertain)):
        if not isinstance(given, Mapping | pd.DataFrame | xr.Dataset):
            raise InputError(
                f"{where}: expected a mapping of names, such as {{'pressure': …}}; got {given!r}"
            )
        for key in given if where != "uncertain" else ():
            if key not in needs:
                raise InputError(f"{where}: unknown column {key!r}{nearest(str(key), needs)}")


def _equally_long(
    rig: type[AbstractActuator], columns: Columns, needs: Mapping[str, Need]
) -> dict[str, Series]:
    """The columns that a rig needs, each an axis of samples of one length."""
    if missing := [key for key in needs if key not in columns]:
        raise InputError(f"columns: {', '.join(missing)} missing; rig {rig.rig!r} has {', '.join(needs)}")
    arrays = {key: _samples(columns[key], key) for key in needs}
    shapes = {key: values.shape for key, values in arrays.items()}
    if len(set(shapes.values())) > 1 or len(next(iter(shapes.values()))) != 1:
        raise InputError(f"columns: expected one axis of samples, of one length for all; got shapes {shapes}")
    return arrays


def _check_numbers(
    rows: int, step: float, noise: Mapping[str, float], horizon: float | None, breaks: Sequence[int]
) -> None:
    """Raise `InputError` for a step, noise, horizon or break that cannot be with so many rows."""
    if rows < 2:
        raise InputError(f"columns: expected at least two samples; got {rows}")
    if not 0 < _number(step) < math.inf:
        raise InputError(f"step: expected the time between two samples, above zero [s]; got {step!r}")
    for key, level in noise.items():
        if not 0 < _number(level) < math.inf:
            raise InputError(f"noise[{key!r}]: expected a standard deviation above zero (SI); got {level!r}")
    if horizon is not None and not step <= _number(horizon) <= rows * step:
        raise InputError(
            f"horizon: expected a time from one step, {step:g} s, to the whole recording, {rows * step:g} s; "
            f"got {horizon!r}"
        )
    if not isinstance(breaks, Sequence | np.ndarray) or isinstance(breaks, str):
        raise InputError(f"breaks: expected a list of rows; got {breaks!r}")
    if wrong := [row for row in breaks if not 0 < _number(row) < rows or int(row) != row]:
        raise InputError(f"breaks: expected rows between 1 and {rows - 1}; got {wrong}")


def _rows_taken(whole: Recording, rig: type[AbstractActuator], asked: RowRequest) -> Recording:
    part = stretch_of(whole.time, asked, repr(whole.name))
    cut = whole.part(part.start, part.stop)
    found = selected(
        repr(whole.name), cut.time, cut.columns, asked, held=rig.commands, largest_step=rig.largest_step,
        breaks=cut.breaks, total=len(whole),
    )  # fmt: skip
    if found.unasked:
        warnings.warn(found.told, LongRecording, stacklevel=3)
    if not found.told:
        return whole
    step = float(found.time[-1] - found.time[0]) / max(len(found.time) - 1, 1)
    return dataclasses.replace(
        cut, time=found.time, step=step, columns=found.columns, breaks=found.breaks, left_out=found.told
    )


def _number(given: object) -> float:
    """A number, NaN for what is none: that passes no check."""
    if isinstance(given, bool | str):
        return math.nan
    try:
        return float(given)  # pyright: ignore[reportArgumentType]
    except (TypeError, ValueError, OverflowError):
        return math.nan


def _samples(given: object, name: str) -> Series:
    try:
        return np.asarray(given, dtype=float)  # pyright: ignore[reportArgumentType, reportCallIssue]
    except (TypeError, ValueError, OverflowError) as error:
        raise InputError(f"columns[{name!r}]: expected an array of numbers; {error}") from error


def _unsure_by_data_sheet(rig: type[AbstractActuator], parts: Mapping[str, str]) -> dict[str, float]:
    """Quantity of the card → standard deviation (SI) by the data sheets of its parts."""
    problems = Problems("data sheet")
    found: dict[str, float] = {}
    for part, kind in parts.items():
        with problems.at(part):
            sheet = sheet_quantities(rig, part, kind)
            found |= {name: q.std for name, q in sheet.items() if q.std is not None}
    problems.check()
    return found


def _deviations(actuator: AbstractActuator, uncertain: Mapping[str, float]) -> dict[str, float]:
    """Quantity of the card → standard deviation, of what the user names in one way or another."""
    spellings, found = spelled(actuator.quantities), {}
    effects = [path for path in known_names(actuator) if path.startswith(EFFECTS)]
    for written, std in uncertain.items():
        if written in (*effects, *(path.removeprefix(EFFECTS) for path in effects)):
            raise InputError(
                f"uncertain: {written!r} is a parameter of an effect, and effects stand in no card of a "
                f"recording from arrays; a fit moves it by free=[{written!r}]"
            )
        key = resolve(spellings, str(written), "uncertain", "unknown quantity {}")
        if key in found:
            raise InputError(f"uncertain: {key!r} is given twice, also as {written!r}; keep one")
        if not 0 < _number(std) < math.inf:
            raise InputError(
                f"uncertain[{written!r}]: expected a standard deviation above zero (SI); got {std!r}"
            )
        found[key] = float(std)
    return found


def _unsure_of(card: Card, uncertain: Mapping[str, float]) -> Card:
    """The card with standard deviations of some of its known quantities.

    The rig need not be registered, which :meth:`Card.updated` asks for.
    """
    unsure = {key: dataclasses.replace(card.known[key], std=std) for key, std in uncertain.items()}
    known = {key: quantity for key, quantity in card.known.items() if key not in unsure}
    return dataclasses.replace(card, known=known, uncertain=unsure)


def _card(
    actuator: AbstractActuator,
    needs: Mapping[str, Need],
    noise: dict[str, float],
    horizon: float | None,
    parts: dict[str, str],
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
    return Card(actuator.rig, columns, known, {}, noise=noise, horizon=horizon, parts=parts)
