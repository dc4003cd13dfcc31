"""Data of a diagnosis: verdict, effects, searches, errors, traces, parameters."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from jaxmuscle import formatting
from jaxmuscle.actuators.actuator import AbstractActuator
from jaxmuscle.diagnosis.evidence import SIGN_FLIPS
from jaxmuscle.effects.base import VARIABLE
from jaxmuscle.estimation.fit import FitResult
from jaxmuscle.parameter_names import ByName, effect_path, spelled
from jaxmuscle.recordings.recording import Recording

Series = NDArray[np.float64]


@dataclasses.dataclass(frozen=True)
class Estimate:
    """A fitted value with its standard deviation, both in `unit` (SI)."""

    value: float
    std: float
    unit: str
    meaning: str


@dataclasses.dataclass(frozen=True)
class FoundEffect:
    """An effect that was added: its parameters and the evidence on data not used for fitting.

    `gain`: part of the excess error (log of 1 + mean square, above noise) on unseen training windows that it
    removed; `p_value` of that, by the `test` named, and number of `stretches` of the recording that tell the
    models with it and without it apart. `kind`: name of the effect in the catalogue; of an error of a
    sensor (`name` ``sensor_offset_pressure``) without its `column`. `declared`, `declared_std`: of a value of
    the card that is found to be wrong (`name` ``constant:mass``), what the card says; `None` of an effect.
    """

    name: str
    signal: str
    meaning: str
    source: str
    parameters: dict[str, Estimate]
    gain: float
    p_value: float
    kind: str = ""
    column: str | None = None
    test: str = SIGN_FLIPS
    stretches: int = 0
    declared: float | None = None
    declared_std: float | None = None

    @property
    def is_constant(self) -> bool:
        """Whether it is a value of the card that is wrong, and no effect."""
        return self.declared is not None

    def __post_init__(self) -> None:
        """Without another kind it is of that of its name; parameters are found by every name of theirs."""
        if not self.kind:
            object.__setattr__(self, "kind", self.name)
        spellings = spelled({name: effect_path(self.name, name) for name in self.parameters})
        object.__setattr__(self, "parameters", ByName(self.parameters, spellings))


@dataclasses.dataclass(frozen=True)
class Alternative:
    """A candidate as it did in the round that added the best one (or none).

    `loss`: typical mean square of its weighted residuals on unseen windows, 1 being the sensors' noise.
    `told_apart`: whether the best one predicts unseen windows significantly better (p < 0.05).
    `judged`: whether it was tried on unseen windows; one that was not counts as told apart, and its gain,
    p-value and loss are those on the windows that it was fitted to, where it removed too little.
    `test`, `stretches`: as of :class:`FoundEffect`. `failed`: whether predictions with it were not numbers
    from any start, so that it could not be tried.
    """

    name: str
    signal: str
    gain: float
    p_value: float
    loss: float
    told_apart: bool
    judged: bool = True
    test: str = SIGN_FLIPS
    stretches: int = 0
    failed: bool = False


@dataclasses.dataclass(frozen=True)
class Round:
    """One search: the loss of the model without any candidate, all best first, and which was added.

    `beside`: where candidates were tried once more for a place that one of them had, the effects that were
    added after it and are in the model. If none was added then, that one was taken out again.
    """

    loss: float
    ranking: tuple[Alternative, ...]
    added: str | None
    beside: tuple[str, ...] = ()


@dataclasses.dataclass(frozen=True)
class Error:
    """Error of one column: root mean square (SI), relative to the column's own spread and to its noise."""

    rmse: float
    unit: str
    nrmse: float
    in_noise: float


TONE, JUMP, DRIFT, RIPPLE, CONSTANT = "tone", "jump", "drift", "ripple", "constant"


@dataclasses.dataclass(frozen=True)
class Pattern:
    """What is left goes with the time, repeats over a measured variable, or is mostly constant.

    Attributes:
        kind: :data:`TONE`, a sine that lasts; :data:`JUMP`, another level from an instant on; :data:`DRIFT`,
            a slow change; :data:`RIPPLE`, a sine over a variable, as of the teeth of a gear;
            :data:`CONSTANT`, about the same at all times.
        variable: what it goes with, "time" or a column.
        at: frequency of a tone [Hz], instant of a jump [s], pitch of a ripple (SI), size of a constant
            (of the missing rate, SI); `None` of a drift.
        unit: of `at`.
        share: part of what is missing that it explains, on stretches that it was not fitted to.
    """

    kind: str
    variable: str
    at: float | None
    unit: str
    share: float

    def __str__(self) -> str:
        """What a sentence says that it does."""
        if self.at is None:
            return "changes slowly in time"
        if self.kind == CONSTANT:
            return f"is mostly constant, about {formatting.quantity(self.at, self.unit)}"
        if self.kind == JUMP:
            return f"has another level from {self.at:.4g} s on"
        size = formatting.quantity(self.at, self.unit, 3)
        if self.kind == TONE:
            return f"swings at {size}, whatever the machine does"
        return f"repeats every {size} of the {formatting.words(self.variable)}"


@dataclasses.dataclass(frozen=True)
class Unexplained:
    """What is left in one signal: the part of the missing rate that the named variables explain.

    `pattern`: how it goes in time or repeats, where that explains more.
    """

    signal: str
    share: float
    depends_on: tuple[str, ...]
    rms_in_noise: float
    pattern: Pattern | None = None


@dataclasses.dataclass(frozen=True)
class Reveal:
    """What is missing in one link against the variable that shows best what is missing.

    `before`, `after`: missing rate of the state behind the output (or the residual of an imposed rig's
    reading) under the final model without `effect` and with it, sample by sample, in `unit`. The same twice
    when no effect was found (`effect` is `None`). `view`: how it is drawn, one of those that
    :class:`~jaxmuscle.effects.AbstractEffect` names; against the time since the machine was last moved both
    are NaN where it moves, begin each time at zero and have one direction.
    """

    effect: str | None
    signal: str
    variable: str
    variable_unit: str
    unit: str
    x: Series
    before: Series
    after: Series
    view: str = VARIABLE


@dataclasses.dataclass(frozen=True)
class Traces:
    """Measured and predicted columns over time; NaN where nothing is predicted.

    `windows`: first row of each window of prediction; `held_out`: rows that no fit has seen.
    """

    time: Series
    measured: dict[str, Series]
    before: dict[str, Series]
    after: dict[str, Series]
    windows: NDArray[np.int64]
    held_out: NDArray[np.bool_]


@dataclasses.dataclass(frozen=True)
class DiagnosisData:
    """What a :class:`~jaxmuscle.diagnosis.result.Diagnosis` holds.

    Attributes:
        verdict: "effects found" (supported by unseen training windows and confirmed by the held-out data),
            "complete" (what is left is noise), "undecided" (between complete and unexplained:
            `missing_in_noise` says how much may be missing), "not confirmed" (effects were supported, but the
            held-out errors did not fall) or "unexplained" (something is missing and nothing explains it).
        effects: what was found, in order; `rounds` tells the searches behind it.
        unconfirmed: what was added and the verdict does not bear out: held-out data contradict it, or it
            leaves most of what is missing. `model` has it.
        refused: effects that unseen windows supported and the last fit does not → why.
        unused: column → number of its readings that do not count: missing, to be ignored, outliers, or beyond
            a stop of the model.
        violated_priors: name of each fitted value that is more than three of the card's standard deviations
            from the card's value → how many.
        missing_in_noise: root mean square of what may be missing, in units of the noise; of the worst
            reading on the training data.
        share_left: of the typical size of what is missing, what the added effects leave, in the worst column
            (:func:`~jaxmuscle.diagnosis.verdict.share_left`); 1 without any where something is missing.
        typical_error: of predictions from the command alone, over a typical window of the training data, in
            units of the noise; of the worst column.
        declared: the machine as declared, fitted to all training data.
        model, fit: the machine as found, and its fit to all training data as :func:`jaxmuscle.fit` does it;
            `None` where the card is sure of everything and nothing was added.
            ``jaxmuscle.fit(diagnosis.model, recording, noise="discrepancy",
            masks=diagnosis.traces.held_out)`` gives the values again. The noise is that of the sensors where
            nothing is missing; elsewhere what the model leaves counts as uncertainty too, else the card's
            priors would weigh nothing. Without the masks held-out rows are fitted too, which must not have a
            say here. A constant of the card that was found has no prior: name it in `free`, with
            ``priors={name: None}``.
        before, after: "training" and "held_out" → column → error.
        parameters: card name, else path, of every fitted parameter of `model` → value; found by every
            spelling of a name (:class:`~jaxmuscle.parameter_names.ByName`).
        correlations: between those parameters.
    """

    recording: Recording
    verdict: str
    effects: tuple[FoundEffect, ...]
    unconfirmed: tuple[FoundEffect, ...]
    refused: dict[str, str]
    unused: dict[str, int]
    violated_priors: dict[str, float]
    missing_in_noise: float
    share_left: float
    typical_error: float
    rounds: tuple[Round, ...]
    declared: AbstractActuator
    model: AbstractActuator
    fit: FitResult | None
    before: dict[str, dict[str, Error]]
    after: dict[str, dict[str, Error]]
    noise: dict[str, float]
    units: dict[str, str]
    horizon: float | None
    held_out_fraction: float
    unexplained: tuple[Unexplained, ...]
    parameters: dict[str, Estimate]
    correlations: pd.DataFrame
    reveal: Reveal | None
    traces: Traces
    converged: bool
    seconds: float
    settings: dict[str, Any]

    def __post_init__(self) -> None:
        """Let parameters be found by every name of theirs."""
        quantities = self.model.quantities
        spellings = spelled({name: quantities.get(name, name) for name in self.parameters})
        object.__setattr__(self, "parameters", ByName(self.parameters, spellings))

    @property
    def added(self) -> tuple[FoundEffect, ...]:
        """Effects that `model` has and the declared one has not, found or not confirmed."""
        return (*self.effects, *self.unconfirmed)

    @property
    def alternatives(self) -> tuple[Alternative, ...]:
        """Runners-up of the first effect in the model, by the last search of several that tried each; best
        first. Else of the first search that added something, else of the first.
        """
        if not self.rounds:
            return ()
        names = [effect.name for effect in self.added]
        adding = [search for search in self.rounds if search.added is not None]
        stayed = [
            each
            for each in adding
            if len(each.ranking) > 1 and each.added and {*each.added.split(" + ")} <= {*names}
        ]
        place = [names.index((each.added or "").split(" + ")[0]) for each in stayed]
        first = [each for each, at in zip(stayed, place, strict=True) if at == min(place)]
        searches = first or (adding or list(self.rounds))[:1]
        latest: dict[str, Alternative] = {}
        for search in reversed(searches):
            for each in search.ranking:
                latest.setdefault(each.name, each)
        return tuple(each for each in latest.values() if each.name != searches[-1].added)
