"""A recording and its card, made ready for fitting."""

from __future__ import annotations

import dataclasses
import math

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from jaxmuscle.actuators.base import AbstractActuator
from jaxmuscle.fitting.prior import Prior
from jaxmuscle.fitting.problem import Problem, problem
from jaxmuscle.fitting.windows import Windows, cut
from jaxmuscle.parameter_names import effect_path
from jaxmuscle.recordings.card import actuator_from_card
from jaxmuscle.recordings.recording import Recording
from jaxmuscle.recordings.track import Observed, observed


@dataclasses.dataclass(frozen=True)
class Case:
    """What a fit or a diagnosis works on.

    Attributes:
        actuator: the machine, as the card declares it unless another was given.
        priors: path of every parameter that the card calls uncertain → what it says of it.
        windows: all windows, held out or not; `problem` holds them all with the sensors' weights.
    """

    recording: Recording
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
        return eqx.tree_at(
            lambda p: (p.rows, p.targets, p.weights),
            dataclasses.replace(whole, total=min(last, whole.total)),
            (kept(whole.rows), select(whole.targets), select(whole.weights)),
        )


def case(
    recording: Recording,
    held_out: float | NDArray[np.bool_],
    ignored: NDArray[np.bool_] | None = None,
    actuator: AbstractActuator | None = None,
    twice: bool = False,
) -> Case:
    """Prepare `recording`.

    Args:
        held_out: fraction of the recording, at its end, that no fit may see; or a mask over its rows.
        ignored: rows whose readings count for nothing: a saturated sensor, a slack muscle.
        actuator: the machine; as the card declares it when `None`.
        twice: smooth measured states twice: they keep their peaks, and what is fitted to them is not biased.
            The rules by which a diagnosis judges were made with states smoothed once.
    """
    card = recording.card
    actuator = actuator_from_card(card) if actuator is None else actuator
    mask = _mask(held_out, len(recording))
    stretches = _stretches(mask, recording.breaks)
    cuts = tuple((np.flatnonzero(np.diff(mask)) + 1).tolist())
    prepared = observed(actuator, recording, card.noise, cuts, twice)
    windows = cut(actuator, stretches, recording.step, card.horizon)
    if ignored is not None:
        windows = windows.ignoring(ignored)
    substeps = max(1, math.ceil(recording.step / actuator.largest_step - 1e-9))
    return Case(
        recording,
        actuator,
        _priors(recording, actuator),
        prepared,
        windows,
        problem(prepared, windows, substeps),
    )


def _mask(held_out: float | NDArray[np.bool_], rows: int) -> NDArray[np.bool_]:
    if np.isscalar(held_out):
        return np.arange(rows) >= round((1 - float(held_out)) * rows)  # pyright: ignore[reportArgumentType]
    return np.asarray(held_out, dtype=bool)


def _stretches(mask: NDArray[np.bool_], breaks: tuple[int, ...]) -> list[tuple[int, int, bool]]:
    """Runs of equal values between breaks, as (first row, end, value)."""
    edges = sorted({0, *breaks, *(np.flatnonzero(np.diff(mask)) + 1).tolist(), len(mask)})
    return [(a, b, bool(mask[a])) for a, b in zip(edges[:-1], edges[1:], strict=True)]


def _priors(recording: Recording, actuator: AbstractActuator) -> dict[str, Prior]:
    card = recording.card
    entries = {actuator.quantities[name]: quantity for name, quantity in card.uncertain.items()}
    for effect, parameters in card.effects.items():
        entries |= {effect_path(effect, name): quantity for name, quantity in parameters.items()}
    return {path: Prior(q.value, q.std) for path, q in entries.items() if q.std is not None}
