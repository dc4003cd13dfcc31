"""Fit a machine to recordings: many starts, one best point, and how far it can be trusted."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping, Sequence

from jaxmuscle.actuators.base import AbstractActuator
from jaxmuscle.configuration import require_double_precision
from jaxmuscle.estimation import checked
from jaxmuscle.estimation.arguments import (
    ESTIMATED,
    Masks,
    asked_for,
    begun_at,
    prepared,
    profiled,
)
from jaxmuscle.estimation.asked import Bounds, PriorLike
from jaxmuscle.estimation.conclude import conclude
from jaxmuscle.estimation.kept import as_settings
from jaxmuscle.estimation.lane import Course
from jaxmuscle.estimation.loss import Loss
from jaxmuscle.estimation.losses import Squares, loss_named
from jaxmuscle.estimation.optimistix_solver import steps_by
from jaxmuscle.estimation.result import FitResult
from jaxmuscle.estimation.search import Search, search
from jaxmuscle.recordings.recording import Recording


def _silent(message: str) -> None:
    """Progress that goes nowhere."""


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
) -> FitResult:
    """Fit parameters of a machine and of the sensors to one or more recordings of its rig.

    In windows of the card's horizon each link of the chain predicts its output from its measured inputs, as
    in a diagnosis. Starts are brought down on short parts of a window, where the cost is smooth, then on
    longer ones and on whole windows, with weights that allow for what the smoothed states leave uncertain.
    A known quantity on which the cards differ is each recording's own.

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
            the residuals themselves, in each recording; by default the card's, or what the fourth differences
            of the data show.
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

    Raises:
        InputError: an unknown parameter, contradictory priors or bounds, too few data, all starts failed,
            a solver that does not step by derivatives.
    """
    require_double_precision("a fit")
    begin = time.monotonic()
    given = checked.given_recordings(actuator, recordings)
    steps, seed = checked.whole(steps, "steps", 1), checked.whole(seed, "seed", 0)
    deadline = begin + checked.seconds(budget, "budget")
    asked = asked_for(free, shared, per_recording, priors, bounds, profiles, continuation)
    rule, by = loss_named(loss), None if solver is None else steps_by(solver)
    objective = prepared(actuator, given, asked, masks, noise, rule)
    points = begun_at(objective.unknowns, starts, seed)
    told = _teller(progress, begin)
    task = Search(objective, points, steps, deadline, noise == ESTIMATED, told, asked.continuation, by)
    settings = as_settings(asked, rule, noise, masks) | {"steps": steps, "seed": seed}
    wanted = profiled(actuator, given, asked, {entry.place.name for entry in objective.unknowns.entries})
    return conclude(search(task), actuator, wanted, settings, progress, begin)


def fit_nearby(
    actuator: AbstractActuator,
    recording: Recording,
    free: Sequence[str],
    priors: Mapping[str, PriorLike],
    masks: Masks = None,
    steps: int = 50,
) -> FitResult:
    """:func:`fit` from an `actuator` that has been fitted: whole windows at once, and nothing is printed.

    It ends in the minimum in which :func:`fit` with the same arguments ends that is begun there.
    """
    begin, asked = time.monotonic(), asked_for(free, (), (), priors, {})
    objective = prepared(actuator, [recording], asked, masks, None, Squares())
    points = begun_at(objective.unknowns, 1, 0)
    task = Search(objective, points, steps, math.inf, False, lambda stage, course: None, near=True)
    settings = as_settings(asked, Squares(), None, masks) | {"steps": steps, "seed": 0}
    return conclude(search(task), actuator, (), settings, _silent, begin)


def _teller(progress: Callable[[str], None], begin: float) -> Callable[[str, Course], None]:
    def tell(stage: str, course: Course) -> None:
        lanes = f"{course.active} under way, {course.ended} ended, {course.waiting} waiting"
        progress(
            f"{stage}, iteration {course.iteration}: cost {course.cost:.6g} "
            f"({lanes}; {time.monotonic() - begin:.1f} s)"
        )

    return tell
