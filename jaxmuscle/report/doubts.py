"""Doubts of a diagnosis: what a reader has to know before relying on it, a sentence each."""

from __future__ import annotations

import dataclasses

import numpy as np

from jaxmuscle import formatting
from jaxmuscle.diagnosis.diagnosis_data import FoundEffect
from jaxmuscle.diagnosis.evidence import LIKELIHOOD_RATIO
from jaxmuscle.diagnosis.result import Diagnosis
from jaxmuscle.diagnosis.verdict import MISSING, differs_from_none, strength_stds
from jaxmuscle.effects.base import strengths_of
from jaxmuscle.formatting import capital, parameter_words, words
from jaxmuscle.parameter_names import effect_path
from jaxmuscle.recordings.smoothing import noise_level

UNDETERMINED = 1.0
"""Standard deviation relative to the value above which a parameter counts as not determined."""

UNEVEN = 3.0
"""Root mean square error, relative to that of a typical stretch, from which few stretches hold most of it."""

LARGE = 10.0
"""Noise, relative to the scatter from sample to sample, from which it is said to hide what is smaller."""


def doubts(diagnosis: Diagnosis) -> list[str]:
    """All of them, the weightiest first; empty when there is none."""
    found = [
        f"{capital(parameter_words(name))} comes out {formatting.rounded(distance)} standard deviations from "
        f"the card: either the card is wrong, or this value makes up for something that the model lacks."
        for name, distance in diagnosis.violated_priors.items()
    ]
    if diagnosis.added and diagnosis.missing_in_noise > MISSING:
        found.append(
            f"About {formatting.rounded(diagnosis.missing_in_noise)} times the sensor noise is still missing "
            f"where the model was fitted."
        )
    found += _uneven(diagnosis)
    found += _more_noise_than_scatter(diagnosis)
    failed = dict.fromkeys(a.name for each in diagnosis.rounds for a in each.ranking if a.failed)
    found += [
        f"{capital(words(name))} could not be tried: with it the model's predictions are not numbers."
        for name in failed
    ]
    found += _few_stretches(diagnosis)
    found += [
        f"{capital(words(name))} helped on unseen training windows and was taken out again: {why}."
        for name, why in diagnosis.refused.items()
    ]
    found += [
        f"{count} readings of {words(column)} do not count: they are missing, were to be ignored, stand out "
        f"singly from those beside them, or lie beyond the stops of the model."
        for column, count in diagnosis.unused.items()
    ]
    of_effects = (
        (*_together(diagnosis, effect), *_undetermined(diagnosis, effect), *_at_bounds(effect))
        for effect in diagnosis.added
    )
    return found + [told for each in of_effects for told in each]


def _uneven(diagnosis: Diagnosis) -> list[str]:
    """A few stretches with large errors bend fits to squares, and other losses hardly see them."""
    rms = max((each.in_noise for each in diagnosis.after["training"].values()), default=0.0)
    typical = max(diagnosis.typical_error, 1.0)
    if rms < UNEVEN * typical:
        return []
    few = (
        f"A few stretches hold most of what is left: the error is {formatting.rounded(rms)} times the sensor "
        f"noise, of a typical stretch {formatting.rounded(typical)} times. "
    )
    if diagnosis.settings.get("loss", "squares") == "squares":
        return [
            f"{few}Fits to squares follow these few; where nothing that belongs to the model makes them, "
            f'diagnose with --loss huber (loss="huber").'
        ]
    return [
        f"{few}The loss that was asked for counts these few little, and so does the verdict: an effect that "
        f"acts only there would not be noticed."
    ]


def _more_noise_than_scatter(diagnosis: Diagnosis) -> list[str]:
    """What is smaller than a noise that is declared far too large does not count as missing."""
    found = []
    for column in diagnosis.after["training"]:
        declared, readings = diagnosis.noise[column], diagnosis.recording.columns[column]
        scatter = noise_level(readings[np.isfinite(readings)])
        if declared <= LARGE * scatter:
            continue
        unit = diagnosis.units[column]
        size = formatting.quantity(declared, unit)
        less = f"scatter by {formatting.quantity(scatter, unit)}" if scatter > 0 else "hardly scatter"
        found.append(
            f"The noise of {words(column)} is taken as {size}, but its readings {less} from one sample to "
            f"the next: what causes errors below {size} is not looked for. With a smaller noise on the card "
            f"it would be."
        )
    return found


def _few_stretches(diagnosis: Diagnosis) -> list[str]:
    """What too short a recording, or one in which little moves, cannot show."""
    found = []
    for each in diagnosis.rounds:
        best = each.ranking[0]
        if best.judged and best.test == LIKELIHOOD_RATIO:
            least = formatting.rounded(0.5**best.stretches)
            found.append(
                f"Only {best.stretches} stretches of this recording tell models with and without "
                f"{words(best.name)} apart: on unseen windows no p-value below {least} could come out. A "
                f"likelihood ratio judged instead, which takes the noise for what it seems to be. A "
                f"recording with more movement would tell."
            )
    return found


def _together(diagnosis: Diagnosis, effect: FoundEffect) -> list[str]:
    """Strengths of an effect that the last fit determines together with its shapes, not by themselves."""
    if effect.is_constant or diagnosis.fit is None:
        return []
    strengths = strengths_of(type(diagnosis.model.effects[effect.name]))
    held = strength_stds(diagnosis.fit, effect.name, strengths)
    found = []
    for name, e in effect.parameters.items():
        path = effect_path(effect.name, name)
        # Not the reported one: that folds disagree has other reasons than the shapes.
        alone = dataclasses.replace(e, std=diagnosis.fit.std.get(path, e.std))
        if held.get(path, alone.std) < alone.std and not differs_from_none(alone):
            found.append(
                f"The {words(name)} of {words(effect.name)} is not determined by itself "
                f"({formatting.estimate(e.value, alone.std, e.unit)}), only together with its other "
                f"parameters: were these known, it would be to {formatting.quantity(held[path], e.unit)}."
            )
    return found


def _undetermined(diagnosis: Diagnosis, effect: FoundEffect) -> list[str]:
    """Parameters of an effect other than its strength of which the data say nothing."""
    if effect.is_constant:
        return []
    strength = diagnosis.model.effects[effect.name].strength
    return [
        f"The {words(name)} of {words(effect.name)} is not determined by this recording "
        f"({formatting.estimate(e.value, e.std, e.unit)})."
        for name, e in effect.parameters.items()
        if name != strength and not e.std <= UNDETERMINED * abs(e.value)
    ]


def _at_bounds(effect: FoundEffect) -> list[str]:
    """Parameters of an effect that ended at a bound, of which the fit gives no standard deviation."""
    return [
        f"The {words(name)} of {words(effect.name)} ended at a bound of what is physical, "
        f"{formatting.quantity(e.value, e.unit)}: how sure that is, the fit does not tell."
        for name, e in effect.parameters.items()
        if e.std == 0 and not effect.is_constant
    ]
