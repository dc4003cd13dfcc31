"""Estimation of parameters from recordings (`jaxmuscle.fit`) and its result, from the request to the
judgement of the best point.
"""

from __future__ import annotations

import dataclasses
import math
import time
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

import jaxmuscle
from jaxmuscle._config import require_double_precision
from jaxmuscle._memory_areas import make_room_for_programs
from jaxmuscle.actuators.actuator import AbstractActuator
from jaxmuscle.estimation import request
from jaxmuscle.estimation.checkpoint import NOTHING_KEPT, Checkpoint, checkpoint_at
from jaxmuscle.estimation.covariance import Minimum
from jaxmuscle.estimation.fingerprint import origin
from jaxmuscle.estimation.fit_data import FitData, correlations, fitted, outcomes
from jaxmuscle.estimation.fit_figure import plot
from jaxmuscle.estimation.fit_files import fitted_card, load, save
from jaxmuscle.estimation.free_parameters import at_bound, moved_machine
from jaxmuscle.estimation.identifiability import identifiability
from jaxmuscle.estimation.initial_states import state_scores
from jaxmuscle.estimation.intervals import profiles, with_conflicts, with_inner_ends
from jaxmuscle.estimation.losses import Loss, Squares, loss_named
from jaxmuscle.estimation.multistart import Found, Search, search
from jaxmuscle.estimation.nonsmooth import without_rough
from jaxmuscle.estimation.objective import SharedProgram
from jaxmuscle.estimation.parameter_layout import labels, layout
from jaxmuscle.estimation.predictions import noise_table, predictions
from jaxmuscle.estimation.prepare import (
    DISCREPANCY,
    ESTIMATED,
    Masks,
    NoiseLike,
    as_settings,
    asked_for,
    begun_at,
    prepared,
    profiled,
)
from jaxmuscle.estimation.request import Asked, Bounds, PriorLike
from jaxmuscle.estimation.residual_analysis import residual_tests, series
from jaxmuscle.estimation.summary import notes, summary, view
from jaxmuscle.estimation.weights import with_discrepancy, with_estimated_noise
from jaxmuscle.optimization.descents import Course, Lane, Limits, Local
from jaxmuscle.optimization.optimistix_solver import steps_by
from jaxmuscle.recordings.card import Card
from jaxmuscle.recordings.recording import Recording


def fitted_start(result: FitData, recordings: object, settings: Mapping[str, Any]) -> dict[str, float]:
    """The fitted values of everything that is free again, a recording's own ones by its name.

    Args:
        recordings, settings: what :func:`jaxmuscle.fit` is to be called with.

    Raises:
        InputError: the arguments cannot be used.
    """
    given = request.given_recordings(result.actuator, recordings)
    asked = asked_for(*(settings[name] for name in ("free", "shared", "per_recording", "priors", "bounds")))
    names = layout(result.actuator, given, labels(given), asked).names
    return {name: value for name, value in result.values.items() if name in names}


@dataclasses.dataclass(frozen=True)
class FitResult(FitData):
    """The outcome of :func:`jaxmuscle.fit`; its numbers are those of :class:`FitData`."""

    def __repr__(self) -> str:
        """What `print(fit)` and a notebook show: values, residuals, notes."""
        return summary(self)

    def _repr_html_(self) -> str:
        """What a notebook shows: values, residuals with their course, notes."""
        return view(self).html()

    def notes(self) -> list[str]:
        """What a reader has to know, one sentence each: how it ended, what is not determined, doubts."""
        return notes(self)

    def to_card(self, recording: str | int = 0) -> Card:
        """The card of a recording with the fitted values and their standard deviations.

        As priors these are for other recordings; fitted to the same one again, its data count twice.
        Each is a prior by itself: a card has no place for correlations. Where these are close to ±1 the card
        knows less of combinations than the fit did, and a fit of new data that begins with it is too sure of
        single values: its intervals are too short. Fit the recordings together instead, as one list.
        """
        return fitted_card(self, recording)

    def plot(self, recording: str | int = 0) -> Figure:
        """A matplotlib figure: fit, residuals, their autocorrelation, and the profiles if there are any."""
        return plot(self, recording)

    def save(self, path: str | Path) -> Path:
        """Write everything, as TOML if `path` ends in ``.toml``, else as JSON.

        :func:`FitResult.load` reads it back without loss.
        """
        return save(self, path)

    @classmethod
    def load(cls, path: str | Path) -> FitResult:
        """A result as it was saved.

        Raises:
            InputError: no such file, or not a saved fit.
        """
        return load(path, cls)

    def refit(self, recordings: Recording | Sequence[Recording], **changes: Any) -> FitResult:
        """Fit again from the fitted values, with the same settings and masks except for `changes`.

        `starts`, `budget` and `solver` are not kept: there is one start, where this fit ended, no limit in
        time, and our own solver.
        """
        settings = {**self.settings, **changes}
        if "starts" not in changes:
            settings["starts"] = [fitted_start(self, recordings, settings)]
        return jaxmuscle.fit(self.actuator, recordings, **settings)


def conclude(
    found: Found,
    wanted: Sequence[str],
    settings: dict[str, Any],
    progress: Callable[[str], None],
    begin: float,
) -> FitResult:
    """Judge the best point of a search; `wanted`: places whose profiles are to be computed."""
    objective, unknowns, u = found.objective, found.objective.unknowns, found.best.u
    progress("judging the fit")
    lines, rough = without_rough(objective, u, series(objective, u))
    ends = at_bound(unknowns, u)
    minimum = Minimum(u, lines, unknowns, objective.loss, ends, state_scores(objective, u, lines))
    sure = minimum.covariance()
    slopes = np.concatenate([line.slopes for line in lines], axis=1)
    idle, combinations = identifiability(slopes, unknowns, u, ends)
    chosen = [i for i, e in enumerate(unknowns.entries) if e.place.name in wanted and not ends[i]]
    if chosen:
        progress("computing profile likelihoods")
    curves = profiles(objective.at, unknowns, (u, found.best.cost), sure, chosen, found.limits)
    machines = tuple(
        moved_machine(station.actuator, unknowns, u, number)
        for number, station in enumerate(objective.stations)
    )
    inputs = [_inputs(station.actuator, station.filled.columns) for station in objective.stations]
    labels = [station.label for station in objective.stations]
    # Standard deviations of the values, from those of the coordinates.
    parameters = fitted(unknowns, u, sure, ends, unknowns.slopes(u), labels)
    parameters = with_conflicts(with_inner_ends(parameters, minimum), minimum)
    return FitResult(
        actuator=machines[0],
        actuators=machines,
        parameters=parameters,
        correlations=correlations(sure, unknowns, ends),
        cost=found.best.cost,
        samples=objective.samples,
        code=found.best.code,
        starts=outcomes(found, sure),
        profiles=tuple(curves),
        undetermined=combinations,
        idle=idle,
        tests=residual_tests(lines, labels, inputs),
        noise=noise_table(objective, lines, sure),
        predictions=predictions(objective, u, machines, lines, sure),
        cards={station.label: station.recording.card for station in objective.stations},
        settings=settings,
        iterations=found.iterations,
        seconds=time.monotonic() - begin,
        rough=rough,
    )


def _inputs(
    actuator: AbstractActuator, columns: dict[str, NDArray[np.float64]]
) -> dict[str, NDArray[np.float64]]:
    """What drives the machine: its commands, or the columns that a bench imposes."""
    imposed = [c for state in actuator.imposed for c in actuator.measured.get(state, ())]
    return {name: columns[name] for name in (*actuator.commands, *imposed)}


def _silent(message: str) -> None:
    """Progress that goes nowhere."""


@dataclasses.dataclass(frozen=True)
class Method:
    """How what is asked for is fitted; the arguments of :func:`jaxmuscle.fit` by these names, and others.

    Attributes:
        deadline: end of the search (`time.monotonic`).
        solver: takes the outcome of a trial into its lane; our own when `None`.
        program: what evaluates the fit, shared with others; one of its own when `None`.
        checkpoint: keeps what is evaluated.
    """

    loss: Loss = dataclasses.field(default_factory=Squares)
    noise: NoiseLike = None
    starts: int | Sequence[Mapping[str, float]] = 1
    steps: int = 50
    seed: int = 0
    deadline: float = math.inf
    solver: Callable[[Lane, Local, Limits], None] | None = None
    program: SharedProgram | None = None
    checkpoint: Checkpoint = NOTHING_KEPT


REWEIGHTINGS = {ESTIMATED: with_estimated_noise, DISCREPANCY: with_discrepancy}
"""Name of a noise that follows from the residuals → the objective with weights by it."""


def estimate(
    actuator: AbstractActuator,
    recordings: Sequence[Recording],
    asked: Asked,
    masks: Masks,
    method: Method,
    progress: Callable[[str], None] = _silent,
) -> FitResult:
    """What :func:`jaxmuscle.fit` does, from arguments that are checked one by one."""
    begin = time.monotonic()
    objective = prepared(actuator, recordings, asked, masks, method.noise, method.loss)
    objective = dataclasses.replace(objective, program=method.program, checkpoint=method.checkpoint)
    task = Search(
        objective,
        begun_at(objective.unknowns, method.starts, method.seed),
        method.steps,
        method.deadline,
        REWEIGHTINGS.get(method.noise) if isinstance(method.noise, str) else None,
        _teller(progress, begin),
        asked.continuation,
        method.solver,
    )
    settings = as_settings(asked, method.loss, method.noise, masks)
    settings |= {"steps": method.steps, "seed": method.seed}
    wanted = profiled(actuator, recordings, asked, {entry.place.name for entry in objective.unknowns.entries})
    return conclude(search(task), wanted, settings, progress, begin)


def fit(
    actuator: AbstractActuator,
    recordings: Recording | Sequence[Recording],
    free: Sequence[str] | None = None,
    *,
    priors: Mapping[str, PriorLike] | None = None,
    bounds: Mapping[str, Bounds] | None = None,
    masks: Masks = None,
    loss: str | Loss = "squares",
    noise: str | Mapping[str, float] | None = None,
    starts: int | Sequence[Mapping[str, float]] = 1,
    shared: Sequence[str] = (),
    per_recording: Sequence[str] = (),
    profiles: Sequence[str] = (),
    continuation: Sequence[float] = (),
    budget: float | None = None,
    steps: int = 50,
    seed: int = 0,
    solver: object = None,
    progress: Callable[[str], None] = _silent,
    resume: str | Path | Checkpoint | None = None,
) -> FitResult:
    """Fit parameters of a machine and of the sensors to one or more recordings of its rig.

    In windows of the card's horizon each link of the chain predicts its output from its inputs, as in a
    diagnosis. Starts are brought down on short parts of a window, where the cost is smooth, then on longer
    ones and on whole windows, with weights that allow for what the smoothed states leave uncertain. Inputs of
    links are as measured, and at last as the fitted model predicts them, where it surely predicts better so
    (:func:`~jaxmuscle.estimation.predicted_inputs.with_predicted_inputs`). A known quantity on which the
    cards differ is each recording's own.

    Args:
        actuator: the machine, of a class of yours or ours; what is not free stays as it is there.
        recordings: as :func:`jaxmuscle.read` or :func:`jaxmuscle.recording` gives them, with NaN for gaps.
        free: names of what is fitted: card quantities, paths, ``offset.COLUMN``, arrays (all their entries)
            and entries of arrays (``weights[3]``), and states at the first sample, ``start.STATE``, else as
            measured or at rest; what the cards call uncertain when `None`. Names in `shared` and
            `per_recording` are free too.
        priors: name → (mean, std) in SI, or `None` for no prior; in place of the card's. What each recording
            has of its own can be named as in the result, ``mass[lift-2]``, here and in `bounds`.
        bounds: name → (lower, upper) in SI, `None` on a side without one.
        masks: bad rows: a boolean array or column → array; for several recordings a list of these or `None`.
        loss: "squares", "huber" or "student", or a :class:`~jaxmuscle.estimation.Loss`.
        noise: column → standard deviation of its sensor, in place of the card's; "estimated" for the size of
            the residuals themselves, in each recording; "discrepancy" for the sensor's and beside it, with
            its correlation, what the model leaves, so that priors keep their weight where the model is
            incomplete (:func:`~jaxmuscle.estimation.weights.with_discrepancy`); by
            default the card's, or what the fourth differences of the data show.
        starts: how many (the machine's own, then a Latin hypercube over the priors), or each one's values.
        shared, per_recording: names with one value for all recordings, and with one for each. By default
            all are shared but ``start.STATE``.
        profiles: names whose profile likelihood is computed, if there is time left.
        continuation: factors by which dry friction is smoothed more widely at first, from wide to narrow:
            ``(30, 6)``, in place of the shortest parts of a window; for a fit that does not arrive by these.
            A rig of your own takes part when it hands `held.widening` to `slip_of_mass`.
        budget: seconds of search, after which the best so far is returned; compilation is not interrupted.
        steps, seed: most steps of a start; seed of the Latin hypercube.
        solver: of optimistix, for least squares (``optimistix.LevenbergMarquardt(rtol=1e-3, atol=1e-3)``,
            ``Dogleg``, ``GaussNewton``) or a minimiser that takes gradients (``optimistix.BFGS``); our own
            trust region when `None`. Its tolerances are of parameters in their standard deviations. Starts,
            bounds, budget and failures are treated alike; a value at a bound is one there.
        progress: called with a line of text at every iteration.
        resume: a file by which an interrupted call goes on (:mod:`jaxmuscle.estimation.checkpoint`); a
            `budget` begins anew.

    Raises:
        InputError: an unknown parameter, contradictory priors or bounds, too few data, all starts failed,
            a solver that does not step by derivatives, a file for `resume` that is another one.
    """
    require_double_precision("a fit")
    make_room_for_programs()
    given = request.given_recordings(actuator, recordings)
    steps, seed = request.whole(steps, "steps", 1), request.whole(seed, "seed", 0)
    deadline = time.monotonic() + request.seconds(budget, "budget")
    by = None if solver is None else steps_by(solver)
    asked = asked_for(free, shared, per_recording, priors, bounds, profiles, continuation)
    rule = loss_named(loss)
    kinds = [type(each) for each in (actuator, *actuator.effects.values(), rule)]
    settings = actuator, asked, masks, vars(rule), noise, starts, steps, seed, solver
    with checkpoint_at(resume, partial(origin, given, kinds, settings), progress, "evaluations") as kept:
        method = Method(rule, noise, starts, steps, seed, deadline, by, checkpoint=kept)
        return estimate(actuator, given, asked, masks, method, progress)


def _teller(progress: Callable[[str], None], begin: float) -> Callable[[str, Course], None]:
    def tell(stage: str, course: Course) -> None:
        lanes = f"{course.active} under way, {course.ended} ended, {course.waiting} waiting"
        progress(
            f"{stage}, iteration {course.iteration}: cost {course.cost:.6g} "
            f"({lanes}; {time.monotonic() - begin:.1f} s)"
        )

    return tell
