"""A recording made ready: machine, usable readings, smoothed states, windows to fit and to hold out."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool
from numpy.typing import NDArray

from jaxmuscle.actuators.actuator import AbstractActuator
from jaxmuscle.errors import InputError
from jaxmuscle.estimation.free_parameters import Prior
from jaxmuscle.estimation.missing_data import Mask, usable
from jaxmuscle.estimation.windows import Problem, Windows, cut, problem, share_of_rows, stretches
from jaxmuscle.parameter_names import effect_path
from jaxmuscle.recordings.card import actuator_from_card
from jaxmuscle.recordings.card_sections import PAST
from jaxmuscle.recordings.recording import Recording
from jaxmuscle.simulation.observed import Observed, begun_from_past, observed


@dataclasses.dataclass(frozen=True)
class Case:
    """What a fit or a diagnosis works on.

    Attributes:
        recording: as it was given, with NaN for readings that are not there.
        filled: the same with every unusable reading replaced by what lies beside it.
        usable: column → rows whose reading is there and counts.
        actuator: the machine, as the card declares it unless another was given.
        priors: path of every parameter that the card calls uncertain → what it says of it.
        windows: all windows, held out or not; `problem` holds them all with the sensors' weights.
    """

    recording: Recording
    filled: Recording
    usable: Mapping[str, Bool[np.ndarray, " rows"]]
    actuator: AbstractActuator
    priors: dict[str, Prior]
    observed: Observed
    windows: Windows
    problem: Problem

    @property
    def training(self) -> Problem:
        """Only the windows that are not held out."""
        keep = ~self.windows.held_out
        kept = lambda values: jnp.asarray(np.asarray(values)[keep])  # noqa: E731
        select = lambda arrays: {out: kept(values) for out, values in arrays.items()}  # noqa: E731
        whole = self.problem
        last = int(self.windows.rows[keep].max()) + self.windows.samples
        share = share_of_rows(self.windows.mask[keep], whole.track.command.shape[0])
        return eqx.tree_at(
            lambda p: (p.rows, p.targets, p.weights),
            dataclasses.replace(whole, total=min(last, whole.total), share=share),
            (kept(whole.rows), select(whole.targets), select(whole.weights)),
        )


def case(
    recording: Recording,
    held_out: float | NDArray[np.bool_],
    masks: Mask | None = None,
    actuator: AbstractActuator | None = None,
    twice: bool = False,
) -> Case:
    """Prepare `recording`.

    Args:
        held_out: fraction of the recording, at its end, that no fit may see; or a mask over its rows.
        masks: rows whose readings count for nothing (a saturated sensor, a slack muscle), of all columns or
            column → rows. Where a measured state is missing for long there is no window.
        actuator: the machine; as the card declares it when `None`.
        twice: smooth measured states twice: they keep their peaks, and what is fitted to them is not biased.
            The rules by which a diagnosis judges were made with states smoothed once.
    """
    card = recording.card
    actuator = actuator_from_card(card) if actuator is None else actuator
    found = usable(actuator, recording, masks)
    mask = _mask(held_out, len(recording))
    cuts = tuple((np.flatnonzero(np.diff(mask) | np.diff(found.cut)) + 1).tolist())
    prepared = observed(actuator, found.recording, card.noise, cuts, twice)
    if card.state_from == PAST:
        prepared = begun_from_past(prepared, actuator, found.recording, cuts)
    parts = stretches(mask, (*recording.breaks, *cuts))
    windows = cut(actuator, parts, recording.step, card.horizon)
    windows = windows.only(~found.cut[windows.rows])
    substeps = max(1, math.ceil(recording.step / actuator.largest_step - 1e-9))
    return Case(
        recording,
        found.recording,
        found.good,
        actuator,
        _priors(recording, actuator),
        prepared,
        windows,
        problem(prepared, windows, substeps, found.ignored),
    )


def check_held_out(held_out: float | NDArray[np.bool_], rows: int) -> None:
    """Make sure that something is held out, and something is not.

    Raises:
        InputError: it is neither a fraction between 0 and 1 nor a mask of all rows with both.
    """
    scalar = np.isscalar(held_out) and not isinstance(held_out, str)
    if scalar and 0 < held_out < 1:  # pyright: ignore[reportOperatorIssue]
        return
    mask = np.asarray(held_out)
    if mask.shape == (rows,) and mask.dtype == bool and 0 < mask.sum() < rows:
        return
    got = repr(held_out) if mask.ndim == 0 else f"{mask.dtype} of shape {mask.shape}"
    if mask.shape == (rows,) and mask.dtype == bool:
        got = "all rows" if mask.any() else "no row"
    raise InputError(
        f"held_out: expected a fraction between 0 and 1, or a boolean for each of the {rows} rows, true for "
        f"some that no fit may see; got {got}"
    )


def check_parts(case: Case) -> None:
    """Make sure that every predicted column has readings that count, to be fitted and held out.

    Raises:
        InputError: one has none in one of the two parts.
    """
    windows, rows = case.windows, np.arange(len(case.recording))
    for part, chosen in (("to be fitted", ~windows.held_out), ("held out", windows.held_out)):
        inside = np.isin(rows, windows.sample_rows(len(rows))[chosen][windows.mask[chosen]])
        for column in (name for names in case.actuator.outputs.values() for name in names):
            if not (inside & case.usable[column]).any():
                raise InputError(
                    f"recording {case.recording.name!r}: no reading of {column!r} that counts is left among "
                    f"the rows {part}; hold out other rows, ignore less, or cut the recording"
                )


def _mask(held_out: float | NDArray[np.bool_], rows: int) -> NDArray[np.bool_]:
    if np.isscalar(held_out):
        return np.arange(rows) >= round((1 - float(held_out)) * rows)  # pyright: ignore[reportArgumentType]
    return np.asarray(held_out, dtype=bool)


def _priors(recording: Recording, actuator: AbstractActuator) -> dict[str, Prior]:
    card = recording.card
    entries = {actuator.quantities[name]: quantity for name, quantity in card.uncertain.items()}
    for effect, parameters in card.effects.items():
        entries |= {effect_path(effect, name): quantity for name, quantity in parameters.items()}
    return {path: Prior(q.value, q.std) for path, q in entries.items() if q.std is not None}
