"""Tables of the report: columns and parameters in the units of the experimenter's card, as texts."""

from __future__ import annotations

import dataclasses
import math
from typing import Any

from jaxmuscle import formatting
from jaxmuscle.actuators import rig_named
from jaxmuscle.actuators.actuator import AbstractActuator
from jaxmuscle.diagnosis.diagnosis_data import Alternative, Estimate, FoundEffect, Pattern, Round
from jaxmuscle.diagnosis.result import Diagnosis
from jaxmuscle.diagnosis.shown_column import shown_column
from jaxmuscle.formatting import listed, meaning, parameter_words, words
from jaxmuscle.parameters import get
from jaxmuscle.recordings.card import Card
from jaxmuscle.recordings.recording import Member, Recording
from jaxmuscle.recordings.schema import Quantity, quantities
from jaxmuscle.units import from_si, scale


def shown_estimate(card: Card, name: str, estimate: Estimate) -> str:
    """A fitted parameter in the unit in which the card gives it, or in one of the right size."""
    entry = card.entries.get(name)
    if entry is None or not entry.unit:
        return formatting.estimate(estimate.value, estimate.std, estimate.unit)
    value, name_of_unit = _in_card_unit(card, entry, estimate.value, estimate.unit)
    std = estimate.std / scale(entry.unit, estimate.unit)
    return formatting.join(formatting.uncertain(value, std), name_of_unit)


def shown_prior(card: Card, name: str, unit: str) -> str:
    """What the card gives for a parameter, with its standard deviation when it has one; "" without."""
    entry = card.entries.get(name)
    return "" if entry is None else shown_estimate(card, name, prior(entry, unit))


def prior(entry: Quantity, unit: str) -> Estimate:
    """The card's value and deviation (NaN without one) as an estimate."""
    return Estimate(entry.value, math.nan if entry.std is None else entry.std, unit, "")


def _in_card_unit(card: Card, entry: Quantity, value: float, si: str) -> tuple[float, str]:
    shift = card.ambient_pressure if entry.reference == "gauge" else 0.0
    return from_si(value - shift, entry.unit, si), formatting.pretty(entry.unit)


REACH = 4.0
"""Card deviations at which the small drawing of a parameter ends."""
SURPRISING, UNINFORMED = 3.0, 0.9
"""Card deviations from which a value is called far off; part of the card's deviation that is no gain."""


def errors(diagnosis: Diagnosis) -> list[dict[str, str]]:
    """One row a predicted column: errors before and after, in the card's unit and in sensor noise."""
    rows = []
    for column in diagnosis.after["held_out"]:
        shown = shown_column(diagnosis, column)
        row = {"column": words(column), "noise": shown.error(diagnosis.noise[column])}
        for when, parts in (("before", diagnosis.before), ("after", diagnosis.after)):
            for part in ("training", "held_out"):
                error = parts[part][column]
                row[f"{part}_{when}"] = shown.error(error.rmse)
                row[f"{part}_{when}_noise"] = formatting.rounded(error.in_noise)
        rows.append(row)
    return rows


def effects(diagnosis: Diagnosis) -> list[dict[str, Any]]:
    """What was added, with parameters and evidence in words."""
    return [
        {
            "name": words(effect.name),
            "signal": words(effect.signal),
            "meaning": meaning(effect.meaning),
            "source": effect.source,
            "evidence": f"{formatting.percent(effect.gain)} ({formatting.probability(effect.p_value)})",
            "constant": effect.is_constant,
            "parameters": _parameters(diagnosis, effect),
        }
        for effect in diagnosis.added
    ]


def _parameters(diagnosis: Diagnosis, effect: FoundEffect) -> list[tuple[str, str, str]]:
    """Name, value and meaning of each parameter; a constant beside what the card says of it."""
    if effect.declared is None:
        return [
            (words(name), formatting.estimate(e.value, e.std, e.unit), e.meaning)
            for name, e in effect.parameters.items()
        ]
    ((name, estimate),) = effect.parameters.items()
    card, std = diagnosis.recording.card, math.nan if effect.declared_std is None else effect.declared_std
    declared = dataclasses.replace(estimate, value=effect.declared, std=std)
    return [
        (words(name), shown_estimate(card, name, estimate), estimate.meaning),
        ("on the card", shown_estimate(card, name, declared), ""),
    ]


def ranking(search: Round) -> list[dict[str, str]]:
    """The candidates of one search, best first."""

    def outcome(candidate: Alternative) -> str:
        if candidate.failed:
            return "could not be tried"
        if not candidate.judged:
            return "explains too little where it is fitted"
        if search.added is None:
            return ""
        if candidate.name == search.added:
            return "added"
        return "worse" if candidate.told_apart else "not told apart"

    return [
        {
            "name": words(candidate.name),
            "signal": words(candidate.signal),
            "gain": formatting.percent(candidate.gain) if candidate.judged else "",
            "p": formatting.probability(candidate.p_value) if candidate.judged else "",
            "loss": formatting.rounded(candidate.loss, 3) if candidate.judged else "",
            "outcome": outcome(candidate),
        }
        for candidate in search.ranking
    ]


def fitted(diagnosis: Diagnosis) -> list[dict[str, Any]]:
    """The fitted parameters beside what the card gave for them."""
    return [_fitted(diagnosis.recording, name, estimate) for name, estimate in diagnosis.parameters.items()]


def where(recording: Recording, name: str) -> str:
    """Of which of several recordings a value is told that differs between them; "" where it does not."""
    first = recording.members[0]
    return f"in {first.name}; in the others as far off" if name in recording.differing(first) else ""


def differing(recording: Recording, member: Member, model: AbstractActuator | None = None) -> str:
    """Values that differ between joined recordings, as they are in one; "" without any.

    On its card, or as a `model` that was fitted to all has them.
    """
    card, values = recording.card, recording.differing(member)
    if model is not None:
        values = {
            name: value + float(get(model, name)) - card.quantities[name].value
            for name, value in values.items()
        }
    units = {name: need.unit for name, need in quantities(rig_named(card.rig)).items()}
    return ", ".join(
        f"{words(name)} {shown_estimate(card, name, Estimate(value, math.nan, units[name], ''))}"
        for name, value in values.items()
    )


def _fitted(recording: Recording, name: str, estimate: Estimate) -> dict[str, Any]:
    card = recording.card
    bar = _bar(card, name, estimate)
    return {
        "name": parameter_words(name),
        "meaning": estimate.meaning,
        "card": shown_prior(card, name, estimate.unit),
        "value": shown_estimate(card, name, estimate),
        "bar": bar,
        "note": "; ".join(filter(None, ("" if bar is None else bar["note"], where(recording, name)))),
    }


def _bar(card: Card, name: str, estimate: Estimate) -> dict[str, Any] | None:
    """Fitted value ± 2 std in deviations from the card's value; `None` where the card gives none."""
    entry = card.entries.get(name)
    if entry is None or entry.std is None or not math.isfinite(estimate.std):
        return None
    before = prior(entry, estimate.unit)
    distance = (estimate.value - before.value) / before.std
    reach = 2 * estimate.std / before.std
    ends = [max(-REACH, min(REACH, x)) for x in (distance - reach, distance, distance + reach)]
    note = ""
    if abs(distance) > SURPRISING:
        note = f"{abs(distance):.1f} σ from the card"
    elif estimate.std > UNINFORMED * before.std:
        note = "the recording says nothing about it"
    return {
        "low": ends[0],
        "middle": ends[1],
        "high": ends[2],
        "note": note,
        "outside": abs(distance) > REACH,
    }


def unexplained(diagnosis: Diagnosis) -> list[dict[str, str]]:
    """What is left, signal by signal."""
    return [
        {
            "signal": words(left.signal),
            "size": formatting.rounded(left.rms_in_noise),
            "share": formatting.percent(left.share),
            "depends_on": listed([words(name) for name in left.depends_on]) if left.depends_on else "",
            "pattern": _share_of_pattern(left.pattern) if left.pattern else "",
        }
        for left in diagnosis.unexplained
    ]


def _share_of_pattern(pattern: Pattern) -> str:
    return f"{formatting.percent(pattern.share)} of it {pattern}"


def correlation(pair: tuple[str, str, float] | None, strong: float) -> str:
    """What the strongest correlation between two parameters means, in words."""
    if pair is None:
        return ""
    first, second = (parameter_words(name) for name in pair[:2])
    if abs(pair[2]) > strong:
        size = f"{first} and {second} are correlated by {pair[2]:.2f}"
        return f"{size}: the recording tells a combination of them better than either alone."
    most = f"{first} and {second}, {pair[2]:.2f}"
    return f"No two parameters are correlated by more than {strong} (most: {most})."
