"""Verdict of a diagnosis: what its final residual, its parameters and the held-out data allow to say."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Float

from jaxmuscle.diagnosis.diagnosis_data import Error, Estimate, FoundEffect
from jaxmuscle.diagnosis.evidence import TELLING
from jaxmuscle.estimation.fit import FitResult
from jaxmuscle.estimation.free_parameters import Prior
from jaxmuscle.formatting import quantity
from jaxmuscle.parameter_names import effect_path, of_effect

MISSING = 2.0
"""Root mean square of what may be missing in a reading, in units of its noise, up to which nothing is said
to be missing. Clean practice recordings leave up to 1.6 (a joint whose bearing gives way before it slides)
and 0.8 (a test machine whose imposed position and pressure are as measured)."""
IMITATED = 0.5
"""Share of what is missing (:func:`share_left`) that effects may leave where they leave something
unexplained: with more, they imitate part of something else. The right effect leaves up to 0.45 on practice
recordings (11, a rough bearing), where the wrong ones of an outsider left 0.7."""
FAR_OFF = 2.5
"""Typical error of predictions from the command alone, in units of the noise, from which the states that
windows begin with are no excuse, if the residuals given the other readings are above the noise as well
(:data:`ABOVE_NOISE`); if they are not, all effects are tried all the same. Lifts with a dead volume were
called complete at 6.2 and 2.7 (blind recordings 100057 and 100041); benches from which nothing is missing
have up to 2.1 (a rough bearing, 100058), or 3.2 of the memory of a muscle with residuals that are noise
(practice recording 09)."""
ABOVE_NOISE = 1.5
"""Mean square residual above which a reading is not taken for the noise of its sensor there."""
MUCH = 3.0
"""Root mean square of what is missing, in units of the noise, from which pairs of effects are tried, and
what refines a friction that was found."""
EXPLAINED = 0.3
"""Share up to which effects that leave something are taken to be the right ones all the same: a rough bearing
leaves a few noise units of several hundred (0.03 on practice recording 12)."""
LITTLE = 0.02
"""The same where they leave much: a joint whose threads and bearing stick leaves 3.8 noise units of 890
(0.01), which no other effect explains; a drift of the force beside a bladder left 6.6 of 110 (0.04)."""
FORM_OF_FRICTION = 0.05
"""Share of what is missing that a law of dry friction may leave by its form: friction of real guides repeats
to a few hundredths at best, and how it builds up over a distance is known no better. A hysteresis of the
muscle's length was added for the 0.02 that a rough thread leaves (blind recordings 122088 and 122148)."""
SURE = 2.0
"""Standard deviations by which the strength of an effect has to differ from none."""
VIOLATED = 3.0
"""Standard deviations of the card from which a fitted value contradicts it."""

SURPRISING = 2.0
"""Held-out error over that on training data from which the training data did not show all."""

Errors = Mapping[str, Mapping[str, Error]]
Squares = Mapping[str, Float[np.ndarray, " windows"]]


def missing_in_noise(
    final: FitResult | None,
    squares: Mapping[str, float],
    noise: Mapping[str, float],
    training: Mapping[str, Error],
) -> float:
    """Root mean square of what may be missing in a reading, in units of its noise; of the worst reading.

    Two residuals bound it, and the smaller one counts: that of the reading given the others as they were
    measured, which suffers from their noise (a joint turns with a slow error of a pressure), and the error of
    the prediction from the command alone, which suffers from the states that windows begin with.

    Args:
        final: the last fit, whose residuals are free of what windows share by the states they begin with.
        squares: column → mean square weighted residual, taken where there was nothing to fit.
        noise: column → noise of its sensor, beside which the fit may have allowed for more.
        training: column → error of predictions from the command alone, on training data.
    """
    levels = dict(squares)
    for columns in () if final is None else final.noise.values():
        for column, each in columns.items():
            levels[column] = (each.ratio * max(each.assumed / noise[column], 1.0)) ** 2
    both = ((levels.get(column, math.inf), error.in_noise**2) for column, error in training.items())
    excess = (min(filter(math.isfinite, pair), default=1.0) - 1 for pair in both)
    return math.sqrt(max(0.0, *excess, 0.0))


def far_off(squares: Mapping[str, float], training: Squares) -> float:
    """Typical size of what predictions from the command miss, in units of the noise, of the worst reading.

    0 where that is not far (:data:`FAR_OFF`), and of readings whose residuals given the others are the noise
    of their sensors (:data:`ABOVE_NOISE`). Where they are not, states that windows begin with are no excuse:
    by freeing them the last fit makes up for what the model lacks.

    Args:
        squares: column → mean square weighted residual of its output given the other readings.
        training: column → mean square error of each training window, predicted from the command alone.
    """
    errors = typical_errors(training).items()
    far = [each for c, each in errors if each > FAR_OFF and squares.get(c, math.inf) > ABOVE_NOISE]
    return math.sqrt(max(far) ** 2 - 1) if far else 0.0


def typical_errors(training: Squares) -> dict[str, float]:
    r"""Column → error of a typical window, :math:`\sqrt{\exp\overline{\ln(1 + m)} - 1}`, in noise units.

    Args:
        training: column → m, mean square error of each window, predicted from the command alone.
    """
    return {column: math.sqrt(typical_square(each)) for column, each in training.items()}


def typical_square(squares: Float[np.ndarray, " windows"]) -> float:
    r"""Mean square of a typical window, :math:`\exp\overline{\ln(1 + m)} - 1`; 0 of none."""
    return math.expm1(np.log1p(squares).mean()) if len(squares) else 0.0


def within_form_of_friction(left: float, at_first: float) -> bool:
    """Whether what is left beside dry friction is no more than its law may leave by its form.

    Args:
        left, at_first: mean square residual with what was found and without, in units of the noise.
    """
    return left - 1 < min(MISSING**2, FORM_OF_FRICTION**2 * (at_first - 1))


def doubted(found: Sequence[FoundEffect], strengths: Mapping[str, Sequence[str]]) -> dict[str, str]:
    """Name of each effect of which no strength is sure to differ from none → why.

    Args:
        strengths: name of an effect → names of its strengths.
    """
    reasons = {}
    for effect in found:
        own = _own_strengths(effect, strengths)
        if not own:
            continue
        if effect.declared is not None:
            std = max(own[0].std, effect.declared_std or 0.0)
            if abs(own[0].value - effect.declared) < VIOLATED * std:
                reasons[effect.name] = "it does not differ from the card's value by three standard deviations"
        elif not any(map(differs_from_none, own)):
            reasons[effect.name] = "its strength does not differ from none by two standard deviations"
    return reasons


def beyond_machines(
    found: Sequence[FoundEffect],
    strengths: Mapping[str, Sequence[str]],
    largest: Mapping[str, float | None],
) -> dict[str, str]:
    """Name of each effect whose first strength differs from none and is one that no real machine has → why.

    Args:
        strengths: name of an effect → names of its strengths.
        largest: name of an effect → size of the first of them on real machines at most, if that is known.
    """
    reasons = {}
    for effect in found:
        own = _own_strengths(effect, strengths)
        most = largest.get(effect.name) or math.inf
        if effect.declared is None and any(map(differs_from_none, own)) and abs(own[0].value) > most:
            value, limit = quantity(own[0].value, own[0].unit), quantity(most, own[0].unit)
            reasons[effect.name] = f"its strength, {value}, is beyond what real machines have, {limit}"
    return reasons


def _own_strengths(effect: FoundEffect, strengths: Mapping[str, Sequence[str]]) -> list[Estimate]:
    return [effect.parameters[name] for name in strengths[effect.name] if name in effect.parameters]


def strength_stds(final: FitResult, effect: str, strengths: Sequence[str]) -> dict[str, float]:
    """Path of each strength of an effect → its standard deviation with the effect's shapes held.

    Empty for what has no parameters of its own, as a constant of the card.
    """
    own = {name: effect_path(effect, name) for name in of_effect(effect, final.parameters)}
    shapes = [path for name, path in own.items() if name not in strengths]
    return {own[name]: final.std_given(own[name], shapes) for name in strengths if name in own}


def differs_from_none(strength: Estimate) -> bool:
    """Whether a strength is more than :data:`SURE` standard deviations from zero."""
    return abs(strength.value) > 0 and abs(strength.value) >= SURE * strength.std


def violated_priors(final: FitResult | None, priors: Mapping[str, Prior]) -> dict[str, float]:
    """Name of each value that contradicts the card → its distance in standard deviations of the card.

    It does beyond :data:`VIOLATED` of them.
    """
    found = {}
    for name, entry in final.parameters.items() if final else ():
        prior = priors.get(entry.path)
        if prior is not None and abs(entry.value - prior.mean) > VIOLATED * prior.std:
            found[name] = abs(entry.value - prior.mean) / prior.std
    return dict(sorted(found.items(), key=lambda item: -item[1]))


def confirmed(before: Errors, after: Errors) -> bool:
    """Whether the held-out errors fell: their geometric mean over the columns.

    Errors below the sensor's noise count as that: less can only be chance.
    """
    fell = 0.0
    for column, error in after["held_out"].items():
        fell += math.log(max(before["held_out"][column].in_noise, 1.0) / max(error.in_noise, 1.0))
    return fell > 0


def share_left(before: Squares, after: Squares) -> float:
    r"""Typical size of what is missing with what was added, over that without it; of the worst column.

    The typical excess of a window is its mean square in units of the noise (:func:`typical_square`), less
    one, over the windows in which either model misses: one window that calls for extrapolation, or begins in
    the middle of a jerk, decides no more than another. Its root is a size.
    Columns count in which that is more than :data:`MISSING` with either model: an error of a sensor as large
    again as its noise, in a pressure of which nothing is missing, is left by every effect of the muscle.

    Args:
        before, after: column → m of every window.
    """
    shares = [0.0]
    for column, squares in before.items():
        pair = np.stack([squares, after[column]])
        telling = pair[:, pair.max(axis=0) > math.expm1(TELLING)]
        if telling.shape[1]:
            old, new = (max(typical_square(each) - 1, 0.0) for each in telling)
            if max(old, new) > MISSING**2:
                shares.append(math.sqrt(new / old) if old > 0 else 1.0)
    return max(shares)


def surprise(errors: Errors) -> float:
    """Root mean square of what held-out data leave beyond training data, in units of the noise; else 0.

    Of the worst column in which the held-out error is more than :data:`SURPRISING` times that on training
    data, which noise and the states that windows begin with enlarge alike.
    """
    excess = [0.0]
    for column, unseen in errors["held_out"].items():
        seen = max(errors["training"][column].in_noise, 1.0)
        if unseen.in_noise > SURPRISING * seen:
            excess.append(math.sqrt(unseen.in_noise**2 - seen**2))
    return max(excess)


def verdict(*, found: bool, left: bool, missing: float, confirms: bool, imitates: bool) -> str:
    """The verdict, one of those that :class:`~jaxmuscle.diagnosis.result.Diagnosis` lists.

    Args:
        found: whether effects were added and are left after the final fit.
        left: whether a reading is left with errors far above its noise.
        missing: as of :func:`missing_in_noise`, or of :func:`surprise` if that is more.
        confirms: whether the held-out errors fell.
        imitates: whether the effects imitate part of something else.
    """
    if found and left and imitates:
        return "unexplained"
    if found:
        return "effects found" if confirms else "not confirmed"
    if left:
        return "unexplained"
    return "undecided" if missing > MISSING else "complete"
