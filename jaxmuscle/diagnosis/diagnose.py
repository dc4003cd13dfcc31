"""Diagnosis (`jaxmuscle.diagnose`): fit, find the effect that unseen data support, add it, refit, repeat;
then conclude.
"""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from jaxmuscle._config import require_double_precision
from jaxmuscle._memory_areas import make_room_for_programs
from jaxmuscle.diagnosis.candidates import missing
from jaxmuscle.diagnosis.card_constants import CardConstant, card_constants
from jaxmuscle.diagnosis.conclusion import conclude, predicted_as_declared
from jaxmuscle.diagnosis.excitation import excited
from jaxmuscle.diagnosis.folds import FOLDS
from jaxmuscle.diagnosis.forward_selection import ForwardSelection, forward_selection
from jaxmuscle.diagnosis.last_fit import Outcome, borne_out
from jaxmuscle.diagnosis.passes import in_passes
from jaxmuscle.diagnosis.ranking import (
    CONCLUSION,
    DECLARED,
    round_work,
)
from jaxmuscle.diagnosis.result import Diagnosis
from jaxmuscle.diagnosis.workbench import Workbench, workbench
from jaxmuscle.effects import CATALOGUE, EXTENSION, ONLY_RIVALS, Presliding, reading_effects
from jaxmuscle.effects.base import AbstractEffect
from jaxmuscle.estimation.case import Case, case, check_held_out, check_parts
from jaxmuscle.estimation.checkpoint import Checkpoint, checkpoint_at
from jaxmuscle.estimation.fingerprint import origin
from jaxmuscle.estimation.losses import Loss, loss_named
from jaxmuscle.estimation.missing_data import Mask
from jaxmuscle.estimation.outliers import bad_rows
from jaxmuscle.parallel import in_background
from jaxmuscle.progress import Meter, Progress, interruptible
from jaxmuscle.recordings.card import actuator_from_card
from jaxmuscle.recordings.joining import of_one_bench
from jaxmuscle.recordings.recording import Recording
from jaxmuscle.recordings.spans import ends_of_members

HELD_OUT = 0.3
"""Fraction of a recording, at its end, that is kept for reporting where nothing else is asked for."""


def _silent(progress: Progress) -> None:
    """Progress that goes nowhere."""


def diagnose(
    recording: Recording | Sequence[Recording],
    *,
    held_out: float | NDArray[np.bool_] | None = None,
    ignored: Mask | None = None,
    catalogue: Sequence[type[AbstractEffect]] | None = None,
    further: Sequence[type[AbstractEffect]] = (),
    constants: bool = True,
    loss: str | Loss = "squares",
    progress: Callable[[Progress], None] = _silent,
    resume: str | Path | Checkpoint | None = None,
) -> Diagnosis:
    """Fit the model that a recording's card declares and find what it lacks.

    Every round fits the present model and the model with each candidate on some of the training windows
    and judges them on the others, fold by fold. What a model leaves counts as uncertainty beside the noise of
    the sensors, with its correlation, so that the card's priors keep their weight. The best candidate is
    added when unseen windows support it with p < 0.01, all candidates of the round and the correlation of
    residuals in time allowed for (the second with p < 0.005, the third with p < 0.0025). Where too few
    stretches of the recording move for that, a likelihood ratio decides with p < 0.0001. Where no candidate
    is supported, or the first one leaves more than three noise units, pairs are tried. Then everything is
    refitted; at most three effects are added. One whose strength the last fit leaves within two standard
    deviations of none is taken out again. The held-out rows take no part in that: they give the errors that
    are reported, and confirm what was found, or not.

    Args:
        recording: as :func:`jaxmuscle.read` gives it; or several of one bench, each a run of its own, whose
            cards tell of one machine; values on them may differ (another weight), and each is simulated with
            its own (:func:`~jaxmuscle.recordings.joining.of_one_bench`).
        held_out: fraction of the recording, of each of several, at its end, kept for reporting; or a mask
            over its rows, those of several one after the other. When `None`, the rows that the card holds
            out, else 0.3.
        ignored: rows whose readings count for nothing (a saturated sensor, a slack muscle), of all columns
            or column → rows, beside those that the card ignores. Readings that are NaN do not count either,
            nor do single ones that stand out from those beside them
            (:func:`~jaxmuscle.estimation.outliers.outliers`).
        catalogue: effects to choose from. When `None`, those of :data:`jaxmuscle.effects.CATALOGUE`. Where
            these leave something (more than :data:`~jaxmuscle.diagnosis.verdict.MISSING`, or the verdict
            would be "unexplained", or predictions from the command are far off), they are tried once more
            with inputs of links as predicted, beside friction that builds up over a distance
            (:class:`~jaxmuscle.effects.Presliding`), and with those of :data:`jaxmuscle.effects.EXTENSION`
            and the errors of the sensors of every column (:mod:`jaxmuscle.diagnosis.passes`). Each counts if
            it leaves less. The first effect that is found is tried
            against these rarer ones, and an eccentric sprocket (:mod:`~jaxmuscle.diagnosis.rivals`): it stays
            unless one predicts unseen windows significantly better, and those that do as well cannot be told
            apart from it.
            Constants are tried beside the usual effects where these leave something, or bend a value by more
            than three standard deviations of the card; with a `catalogue` of your own, beside it.
        further: effects, such as your own, that are sought beside those of the catalogue from the start.
        constants: whether a value of the card may be wrong too (a mass, a length, a braid angle, the supply
            pressure): each is a candidate beside the effects, and is found where it explains most of what is
            missing and no effect does as well
            (:mod:`jaxmuscle.diagnosis.constant_ranking`). Then ``constant:mass`` stands among the effects.
        loss: by which models are fitted: "squares", "huber", "student", or a
            :class:`~jaxmuscle.estimation.Loss`, as in :func:`jaxmuscle.fit`. Under squares a few stretches
            with large errors that no model explains (a blow, a jammed guide) bend all values. What is missing
            is judged alike under each: stretch by stretch, by the logarithm of one plus the mean square.
        progress: called at each step with a :class:`~jaxmuscle.progress.Progress`, whose text is a line:
            `print` will do.
        resume: a file by which an interrupted call goes on (:mod:`jaxmuscle.estimation.checkpoint`).

    Returns:
        a :class:`Diagnosis`; its verdict is "effects found", "complete" (nothing is missing), "undecided"
        (a little may be), "not confirmed" (held-out data contradict what was found) or "unexplained"
        (something is missing, and no effect of the catalogue explains it).

    Raises:
        InputError: a fraction that is none, a mask of another length, masks that leave too little; several
            recordings that are not of one bench; a file for `resume` that is another one.
    """
    make_room_for_programs()
    whole = recording if isinstance(recording, Recording) else of_one_bench(recording)
    meter = Meter(progress)
    kept_out = _held_out(whole, held_out)
    chosen = (*(CATALOGUE if catalogue is None else catalogue), *further)
    kinds = [type(actuator_from_card(whole.card)), *chosen]
    rule = loss_named(loss)
    settings = kept_out, ignored, catalogue is None, constants, vars(rule)
    of = partial(origin, [whole], [*kinds, type(rule)], settings)
    kept = Checkpoint(None) if resume is None else resume  # what one pass has fitted serves the next ones
    with checkpoint_at(kept, of, partial(meter.did, 0.0), "fits") as checkpoint:

        def work() -> Diagnosis:
            seek = partial(
                _diagnosed, _prepared(whole, kept_out, ignored, rule), meter=meter, checkpoint=checkpoint
            )
            if catalogue is not None:
                found = seek(chosen, constants=constants)
                assert found is not None
                return found
            rarer = (*EXTENSION, *reading_effects(kinds[0]))
            seek = partial(seek, refinements=(Presliding,), rivals=(*rarer, *ONLY_RIVALS))
            return in_passes(seek, chosen, rarer, constants)

        return interruptible(work, meter.stop)


def _held_out(recording: Recording, held_out: float | NDArray[np.bool_] | None) -> float | NDArray[np.bool_]:
    """What is kept for the last word, of what was asked for; as the card says where nothing was."""
    if held_out is None:
        held_out = HELD_OUT if recording.held_out is None else recording.held_out
    check_held_out(held_out, len(recording))
    if np.ndim(held_out) == 0 and recording.joined_from:
        return ends_of_members(recording, float(held_out))  # pyright: ignore[reportArgumentType]
    return held_out


@dataclasses.dataclass(frozen=True)
class _Prepared:
    """A recording made ready for every search; `masks`: column → rows whose readings count for nothing.

    `fallible`: constants of the card that may be wrong; `loss`: by which models are fitted.
    """

    case: Case
    masks: Mapping[str, NDArray[np.bool_]]
    fallible: Sequence[CardConstant]
    loss: Loss


def _prepared(
    recording: Recording, held_out: float | NDArray[np.bool_], ignored: Mask | None, loss: Loss
) -> _Prepared:
    require_double_precision("a diagnosis")
    masks = bad_rows(recording, ignored)
    ready = case(recording, held_out, masks)
    check_parts(ready)
    return _Prepared(ready, masks, card_constants(ready), loss)


def _diagnosed(
    ready: _Prepared,
    catalogue: Sequence[type[AbstractEffect]],
    first: type[AbstractEffect] | None = None,
    *,
    constants: bool = False,
    refinements: Sequence[type[AbstractEffect]] = (),
    rivals: Sequence[type[AbstractEffect]] = (),
    predicting: bool = False,
    whole: bool = False,
    if_found: bool = False,
    meter: Meter,
    checkpoint: Checkpoint,
) -> Diagnosis | None:
    """A search among a catalogue; `constants`: whether those of the card are among the candidates.

    An effect with a strength that no real machine has leaves its place: it is searched again without it.

    Args:
        first: an effect without which none of the others is tried.
        refinements: effects that are tried once a dry friction was found.
        rivals: effects that are tried against the first one that was found.
        predicting: whether links have inputs as models predict them, where they may.
        whole: whether it searches whole windows, not parts of them.
        if_found: whether it ends with `None` where nothing was found: what is left then needs no last fit.
    """
    begin = time.perf_counter()
    refused: dict[str, str] = {}
    while True:
        usual, refining, against = (
            [effect for effect in kinds if effect.name not in refused]
            for kinds in (catalogue, refinements, rivals)
        )
        bench = _bench(ready, usual, refining, against, constants, predicting, checkpoint)
        selection, outcome = _selected(ready, bench, first, whole, meter)
        if if_found and not selection.found:
            meter.skip_to(0.0, "nothing more was found")
            return None
        meter.skip_to(CONCLUSION, "predicting the held-out data")
        begun = in_background(partial(predicted_as_declared, ready.case, outcome))
        last = borne_out(ready.case, bench, selection.training, outcome)
        refused |= {name: last.refused[name] for name in last.beyond_machines}
        if not last.beyond_machines:
            break
    last = dataclasses.replace(last, refused=refused | dict(last.refused))
    return conclude(ready.case, bench, selection.training, last, begun.result, begin)


def _bench(
    ready: _Prepared,
    usual: Sequence[type[AbstractEffect]],
    refinements: Sequence[type[AbstractEffect]],
    rivals: Sequence[type[AbstractEffect]],
    constants: bool,
    predicting: bool,
    checkpoint: Checkpoint,
) -> Workbench:
    """The workbench for what a recording can show of some effects; of the others those that are not usual."""
    actuator = ready.case.actuator
    return workbench(
        ready.case,
        excited(ready.case, actuator, missing(actuator, usual)),
        constants=ready.fallible if constants else (),
        refinements=[e for e in missing(actuator, refinements) if e not in usual],
        rivals=[e for e in missing(actuator, rivals) if e not in usual],
        checkpoint=checkpoint,
        predicting=predicting,
        loss=ready.loss,
    )


def _selected(
    ready: _Prepared, bench: Workbench, first: type[AbstractEffect] | None, whole: bool, meter: Meter
) -> tuple[ForwardSelection, Outcome]:
    """A search on a workbench at its end, and what it found."""
    candidates = bench.sought((), much_is_left=False)
    meter.expect(DECLARED + round_work([*candidates, *bench.constants], FOLDS) + CONCLUSION)
    selection = forward_selection(ready.case, bench, meter, first)
    declared = selection.model
    if first is None or (first in candidates and selection.begin_with(first)):
        selection.seek(whole)
    return selection, Outcome(
        declared,
        selection.model,
        tuple(selection.found),
        tuple(selection.rounds),
        selection.folds,
        selection.converged,
        ready.masks,
    )
