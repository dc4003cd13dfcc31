"""Validation of a table against its card: the clock, gauge or absolute pressure, signals that move.

Each check holds for every sound recording; what it refuses would spoil a fit without a sign.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from jaxmuscle.actuators import RIGS
from jaxmuscle.errors import InputError, Problems
from jaxmuscle.recordings import schema
from jaxmuscle.recordings.card import Card
from jaxmuscle.recordings.card_sections import SUPPLY
from jaxmuscle.recordings.clocks import LONGEST_GAP
from jaxmuscle.recordings.schema import Quantity
from jaxmuscle.recordings.table import Table
from jaxmuscle.units import Series, from_si, meant

FEWEST_ROWS = 200
JITTER = 0.01
"""Largest deviation of a sampling step from the median one, relative to it."""
STEPS = (1e-6, 10.0)
"""Range of sampling steps that a muscle is recorded with [s]."""
OVER_SUPPLY = 1.05
"""Ratio of a measured pressure to the supply's beyond all errors of sensors (absolute)."""
UNDER_AMBIENT = 0.5
"""Ratio of a measured pressure to the ambient one below which no muscle that vents to ambient goes."""


def check_clock(table: Table, card: Card, time: Series, fewest: int = FEWEST_ROWS) -> None:
    """Raise `InputError` unless there are enough samples, at increasing times, at a plausible step."""
    where = f"{table.file}, column {card.columns['time'].column!r}"
    if len(time) < fewest:
        raise InputError(f"{table.file}: expected at least {fewest} rows of samples; got {len(time)}")
    gaps = np.diff(time)
    back = np.flatnonzero(gaps <= 0)
    if back.size:
        first = back[0]
        what = "repeats" if gaps[first] == 0 else "goes back"
        count = "" if back.size == 1 else f"; {back.size} such rows"
        raise InputError(
            f"{where}, row {table.row(first + 1)}: time has to increase; it {what}, "
            f"{time[first + 1]:.12g} s after {time[first]:.12g} s{count}. "
            f"Remove repeated rows, sort the rest, or write time with more digits"
        )
    step = float(np.median(gaps))
    if not STEPS[0] <= step <= STEPS[1]:
        unit = card.columns["time"].unit
        raise InputError(
            f"{where}: a sampling step of {step:.3g} s is not plausible; expected {STEPS[0]:g} to "
            f"{STEPS[1]:g} s. Is time really in {unit!r}?"
        )


def is_regular(time: Series) -> bool:
    """Whether no sampling step deviates by more than 1 % from the median one."""
    gaps = np.diff(time)
    return bool(np.all(np.abs(gaps / np.median(gaps) - 1) <= JITTER))


def check_regular(table: Table, card: Card, time: Series, *, resample: bool) -> None:
    """Raise `InputError` when the clock is irregular and is not to be resampled, or cannot be."""
    if is_regular(time):
        return
    gaps = np.diff(time)
    step = float(np.median(gaps))
    worst = int(np.argmax(np.abs(gaps - step)))
    where = (
        f"{table.file}, column {card.columns['time'].column!r}, row {table.row(worst + 1)}: irregular "
        f"sampling, {gaps[worst]:.4g} s after the sample at {time[worst]:.12g} s; "
        f"the median step is {step:.4g} s"
    )
    if gaps[worst] > LONGEST_GAP * step:
        raise InputError(
            f"{where}; a gap of more than {LONGEST_GAP} steps cannot be bridged. "
            f"Take what lies before or behind it: stretch=(FROM, TO), --stretch FROM:TO"
        )
    if not resample:
        count = int((np.abs(gaps / step - 1) > JITTER).sum())
        raise InputError(
            f"{where}; {count} steps deviate by more than {JITTER:.0%}. "
            f"Export it at a constant rate, or resample it: resample=True, --resample"
        )


def check_horizon(table: Table, card: Card, time: Series) -> None:
    """Raise `InputError` when the card's horizon does not fit into the recording."""
    length, step = time[-1] - time[0], float(np.median(np.diff(time)))
    if card.horizon is not None and not step <= card.horizon <= length:
        raise InputError(
            f"{card.file or 'card'}: [fit] horizon: expected a time from one sampling step, {step:.4g} s, to "
            f"the length of {table.file}, {length:.4g} s; got {card.horizon:g} s. Change it, or remove it "
            f"to have the whole predicted in one go"
        )


def check_signals(table: Table, card: Card, columns: Mapping[str, Series]) -> None:
    """Raise `InputError` for pressures that cannot be, commands or outputs that do not move.

    Args:
        table: for file and rows.
        card: what the columns are declared to be.
        columns: quantity → samples in SI, pressures absolute.
    """
    rig, problems = RIGS[card.rig], Problems(table.file)
    names = _called(card, columns)
    _note_pressures(table, card, columns, problems)
    still = {name for name, values in columns.items() if np.ptp(values) == 0}
    imposed = schema.imposed_columns(rig)
    if imposed and still.issuperset(imposed):
        where = " and ".join(names[name] for name in imposed)
        problems.add(where, "constant throughout; there is nothing to identify. Use a recording that moves")
    for name in schema.predicted_columns(rig):
        if name in still:
            value = f"{columns[name][0]:.6g} {schema.columns(rig)[name].unit}"
            problems.add(names[name], f"constant, {value}; is it the right column, does the sensor work?")
    problems.check()


def check_pressures(table: Table, card: Card, columns: Mapping[str, Series]) -> None:
    """Raise `InputError` for pressures that cannot be; arguments as of :func:`check_signals`."""
    problems = Problems(table.file)
    _note_pressures(table, card, columns, problems)
    problems.check()


def _note_pressures(table: Table, card: Card, columns: Mapping[str, Series], problems: Problems) -> None:
    rig, names = RIGS[card.rig], _called(card, columns)
    needs = schema.columns(rig)
    for name, values in columns.items():
        if needs[name].referenced:
            problem = _impossible_pressure(table, card, name, values, name in rig.commands)
            if problem is not None:
                problems.add(names[name], problem)


def _called(card: Card, columns: Mapping[str, Series]) -> dict[str, str]:
    """Quantity → what messages call its column."""
    return {name: f"column {card.columns[name].column!r} ({name})" for name in columns}


def _impossible_pressure(
    table: Table, card: Card, name: str, pressure: Series, commanded: bool
) -> str | None:
    """What is wrong with a pressure, the surest sign first; `None` when nothing is."""
    reference, supply = card.columns[name].reference, card.quantities.get(SUPPLY)
    swap = f"is it {'gauge' if reference == 'absolute' else 'absolute'} rather than {reference}?"
    check = "Check unit and reference in [columns]"
    # Taken as absolute, a gauge pressure below vacuum would lie below vacuum all the more.
    signs = [(pressure < 0, "below vacuum", f"{swap} {check}" if reference == "absolute" else check)]
    if reference == "absolute" and not commanded:
        low = pressure < UNDER_AMBIENT * card.ambient_pressure
        signs.append((low, f"far below the ambient {_bar(card.ambient_pressure)}", swap))
    if supply is not None and not commanded:
        high = pressure > OVER_SUPPLY * supply.value + 3 * (supply.std or 0.0)
        remedy = f"{swap} {check} and those of {SUPPLY}"
        if pressure.max() - card.ambient_pressure > 2 * supply.value:  # More than the ambient pressure.
            remedy = (
                f"{_likely_units(card, name, float(pressure.max()), supply)}{check} and those of {SUPPLY}"
            )
        signs.append((high, f"above the supply pressure, {_bar(supply.value)}", remedy))
    for rows, what, remedy in signs:
        if rows.any():
            first = int(np.argmax(rows))
            count = "" if rows.sum() == 1 else f" ({rows.sum()} such rows)"
            return f"{_bar(pressure[first])} in row {table.row(first)} is {what}{count}; {remedy}"
    return None


def _likely_units(card: Card, name: str, most: float, supply: Quantity) -> str:
    """The unit in which the largest pressure would be below the supply's, or that above it."""
    found = []
    for spec, number, fits, where in (
        (card.columns[name], most, lambda p: 0.1 * supply.value < p < OVER_SUPPLY * supply.value, ""),
        (supply, supply.value, lambda p: most < OVER_SUPPLY * p < 10 * most, f" of {SUPPLY}"),
    ):
        shift = card.ambient_pressure if spec.reference == "gauge" else 0.0
        sound = lambda p, fits=fits, shift=shift: fits(p + shift)  # noqa: E731
        likely = meant(from_si(number - shift, spec.unit, "Pa"), spec.unit, "Pa", sound)
        found += [f"{likely}{where}"] if likely else []
    return f"is it {', or '.join(found)}? " if found else ""


def _bar(pressure: float) -> str:
    return f"{pressure / 1e5:.4g} bar absolute"
