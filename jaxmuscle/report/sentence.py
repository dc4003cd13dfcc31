"""The outcome of a diagnosis in one plain sentence."""

from __future__ import annotations

import dataclasses
import math

from jaxmuscle import formatting
from jaxmuscle.diagnosis.diagnosis_data import Error, FoundEffect
from jaxmuscle.diagnosis.result import Diagnosis
from jaxmuscle.diagnosis.shown_column import shown_column
from jaxmuscle.diagnosis.verdict import differs_from_none, surprise
from jaxmuscle.effects.base import strengths_of
from jaxmuscle.formatting import capital, listed, parameter_words, words
from jaxmuscle.report.tables import shown_estimate, where

NO_BETTER = 0.98
"""An error that falls by less than this factor has not fallen."""
FAR = 3.0
"""Times the sensor noise above which the headline says that an error is still large."""


def sentence(diagnosis: Diagnosis) -> str:
    """What a lab mate should know first; errors are those on unseen data, in the units of the card."""
    said = BY_VERDICT[diagnosis.verdict](diagnosis)
    return f"{said} {_against_the_card(diagnosis)}".rstrip()


def _against_the_card(diagnosis: Diagnosis) -> str:
    """The value that contradicts the card most; "" if none does."""
    if not diagnosis.violated_priors:
        return ""
    name, far = next(iter(diagnosis.violated_priors.items()))
    return (
        f"But {parameter_words(name)} comes out {formatting.rounded(far)} standard deviations from the card."
    )


def telling_column(diagnosis: Diagnosis) -> str:
    """The predicted column in which most was gained, or is left to gain, in units of its noise."""
    before, after = diagnosis.before["held_out"], diagnosis.after["held_out"]
    if diagnosis.added and diagnosis.verdict != "unexplained":
        return max(after, key=lambda column: before[column].in_noise - after[column].in_noise)
    return max(after, key=lambda column: after[column].in_noise)


def indistinguishable(diagnosis: Diagnosis) -> list[str]:
    """Runners-up that predict unseen windows no worse than the effect that was added first, in words.

    Those that were added later are no rivals of it: the model has both.
    """
    if not diagnosis.added:
        return []
    added = {effect.name for effect in diagnosis.added}
    rivals = [a.name for a in diagnosis.alternatives if not a.told_apart and a.name not in added]
    return [words(name).replace(" + ", " with ") for name in rivals]


def effect_phrase(diagnosis: Diagnosis, effect: FoundEffect) -> str:
    """An added effect with the value of its strength: ``load friction, 16.2 ± 0.4 N``; of a constant what
    it is and what the card says: ``a braid angle of 26.4 ± 0.1 deg and not 22 deg as on the card``.

    Of several strengths it is the first one that differs from none.
    """
    if effect.declared is not None:
        return _constant_phrase(diagnosis, effect, effect.declared)
    known = strengths_of(type(diagnosis.model.effects[effect.name]))
    own = {name: effect.parameters[name] for name in known if name in effect.parameters}
    if not own:
        return words(effect.name)
    strength = next((name for name, each in own.items() if differs_from_none(each)), next(iter(own)))
    estimate = own[strength]
    value = formatting.estimate(estimate.value, estimate.std, estimate.unit)
    plain = len(effect.parameters) == 1 and estimate.unit
    return f"{words(effect.name)}, {value}" if plain else f"{words(effect.name)} ({words(strength)} {value})"


def _constant_phrase(diagnosis: Diagnosis, effect: FoundEffect, declared: float) -> str:
    ((name, estimate),) = effect.parameters.items()
    card = diagnosis.recording.card
    before = dataclasses.replace(estimate, value=declared, std=math.nan)
    article = "an" if name[0] in "aeiou" else "a"
    values = (shown_estimate(card, name, each) for each in (estimate, before))
    place = where(diagnosis.recording, name)
    return f"{article} {words(name)} of {' and not '.join(values)} as on the card{place and f' ({place})'}"


def _found(diagnosis: Diagnosis) -> str:
    column = telling_column(diagnosis)
    shown = shown_column(diagnosis, column)
    before, after = (part["held_out"][column] for part in (diagnosis.before, diagnosis.after))
    rivals = indistinguishable(diagnosis)
    doubt = f", from which {listed(rivals)} cannot be told apart here" if rivals else ""
    verb = "fell" if after.rmse < NO_BETTER * before.rmse else "did not fall: it went"
    change = f"{verb} from {shown.error(before.rmse)} to {shown.error(after.rmse)}"
    if after.in_noise > FAR:
        change += f", still {formatting.rounded(after.in_noise)} times the sensor noise,"
    return f"{capital(words(column))} error on unseen data {change} {_change(diagnosis)}{doubt}."


def _change(diagnosis: Diagnosis) -> str:
    """What makes the declared model the one that was found."""
    constants = [effect_phrase(diagnosis, effect) for effect in diagnosis.added if effect.is_constant]
    effects = [effect_phrase(diagnosis, effect) for effect in diagnosis.added if not effect.is_constant]
    parts = [f"with {listed(constants)}"] if constants else []
    parts += [f"after adding {listed(effects)}"] if effects else []
    return ", ".join(parts)


def _complete(diagnosis: Diagnosis) -> str:
    return f"Nothing is missing: the declared model predicts unseen data to {_levels(diagnosis)}."


def _levels(diagnosis: Diagnosis) -> str:
    errors = diagnosis.after["held_out"]
    parts = [f"{words(c)} {shown_column(diagnosis, c).error(error.rmse)}" for c, error in errors.items()]
    worst = formatting.rounded(max(error.in_noise for error in errors.values()))
    return f"{worst} times the sensor noise ({', '.join(parts)})"


def _undecided(diagnosis: Diagnosis) -> str:
    size = formatting.rounded(max(diagnosis.missing_in_noise, surprise(diagnosis.after)))
    return (
        f"No effect is supported by this recording, but something of about {size} times the sensor noise may "
        f"be missing: the declared model predicts unseen data to {_levels(diagnosis)}."
    )


def _unconfirmed(diagnosis: Diagnosis) -> str:
    column = telling_column(diagnosis)
    shown = shown_column(diagnosis, column)
    before, after = (part["held_out"][column].rmse for part in (diagnosis.before, diagnosis.after))
    return (
        f"Not confirmed: training data support {_added(diagnosis)}, but on unseen data the errors did not "
        f"fall ({words(column)} {shown.error(before)} before, {shown.error(after)} after)."
    )


def _unexplained(diagnosis: Diagnosis) -> str:
    column = telling_column(diagnosis)
    off = _off(diagnosis, column, diagnosis.after["held_out"][column])
    where = ""
    if diagnosis.unexplained:
        most = max(diagnosis.unexplained, key=lambda left: left.rms_in_noise)
        where = f"; it acts on the {words(most.signal)}"
        if most.pattern:
            where += f" and {most.pattern}"
        elif most.depends_on:
            where += f" and depends on {listed([words(name) for name in most.depends_on])}"
    first = f"Even with {_added(diagnosis)}, something" if diagnosis.added else "Something"
    return (
        f"{first} is missing that no effect of the catalogue explains: "
        f"on unseen data {words(column)} is off by {off}{where}."
    )


def _added(diagnosis: Diagnosis) -> str:
    return listed([effect_phrase(diagnosis, effect) for effect in diagnosis.added])


def _off(diagnosis: Diagnosis, column: str, error: Error) -> str:
    size = shown_column(diagnosis, column).error(error.rmse)
    return f"{size} ({formatting.rounded(error.in_noise)} times the sensor noise)"


BY_VERDICT = {
    "effects found": _found,
    "complete": _complete,
    "undecided": _undecided,
    "not confirmed": _unconfirmed,
    "unexplained": _unexplained,
}
