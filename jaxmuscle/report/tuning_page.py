"""Report of a tuning: one self-contained page with gains, and what they bring where they were not tuned."""

from __future__ import annotations

import datetime
from typing import Any

from jaxmuscle.figure_style import styled, svg_uri
from jaxmuscle.formatting import pretty, quantity, rounded, words
from jaxmuscle.html_template import template
from jaxmuscle.report.page import Picture, versions
from jaxmuscle.tuning import Judged, Tuning
from jaxmuscle.tuning.tuning_result import shown_rise, shown_value

CAPTION = (
    "The worst scenario that was tuned on and the worst one held out, before (grey) and after (orange): what "
    "was wanted and what the sensor shows, the commands, and every term after the tuning over before."
)


def tuning_page(tuned: Tuning, name: str, rig: str, start: str) -> str:
    """The report as one HTML page that needs nothing else.

    Args:
        name: what it is a tuning of; `rig`: the machine's.
        start: what the gains before are, in a few words.
    """
    with styled():
        picture = Picture(svg_uri(tuned.plot()), CAPTION)
    sides = [("training", tuned.before, tuned.after)]
    if tuned.held_out_before is not None and tuned.held_out_after is not None:
        sides.insert(0, ("held out", tuned.held_out_before, tuned.held_out_after))
    content = {
        "t": tuned,
        "name": name,
        "rig": rig,
        "start": start,
        "sentence": tuning_sentence(tuned),
        "verdict": {True: "holds", False: "does not hold", None: "not judged"}[tuned.holds],
        "gains": [_gain(tuned, gain) for gain in tuned.gains],
        "heads": [head for head, *_ in sides],
        "terms": [_term(term, unit, sides) for term, unit in tuned.units.items()],
        "scenarios": [(head, _scenarios(tuned, *both)) for head, *both in sides],
        "picture": picture,
        "settings": {key: _setting(value) for key, value in tuned.settings.items()},
        "versions": versions(),
        "today": datetime.date.today().isoformat(),
    }
    return template("tuning_page.html.j2", "jaxmuscle.report").render(**content)


def tuning_sentence(tuned: Tuning) -> str:
    """The outcome in one sentence."""
    before, after, where = tuned.before, tuned.after, "on what was tuned on; nothing was held out"
    if tuned.held_out_before is not None and tuned.held_out_after is not None:
        before, after, where = tuned.held_out_before, tuned.held_out_after, "on scenarios that were held out"
    if "tracking" not in tuned.units:
        return f"Cost went from {rounded(before.cost, 3)} to {rounded(after.cost, 3)} {where}."
    unit = tuned.units["tracking"]
    values = [shown_value(side.value("tracking"), unit) for side in (before, after)]
    verb = "fell" if after.value("tracking") < before.value("tracking") else "went"
    return f"Tracking error {verb} from {values[0]} to {values[1]} {where}."


def _gain(tuned: Tuning, name: str) -> dict[str, str]:
    gain = tuned.gains[name]
    return {
        "name": words(name),
        "meaning": gain.meaning,
        "unit": pretty(gain.unit),
        "start": rounded(gain.start, 4),
        "value": rounded(gain.value, 4),
        "less": shown_rise(gain.less),
        "more": shown_rise(gain.more),
        "note": f"at its {gain.at_bound} bound, {quantity(gain.value, gain.unit)}" if gain.at_bound else "",
    }


def _term(term: str, unit: str, sides: list[tuple[str, Judged, Judged]]) -> dict[str, Any]:
    values = [shown_value(side.value(term), unit) for _, *both in sides for side in both]
    return {"name": term, "values": values}


def _scenarios(tuned: Tuning, before: Judged, after: Judged) -> list[tuple[str, str, str]]:
    """Name and tracking error, or cost, of each scenario before and after."""
    term = "tracking" if "tracking" in after.terms else "cost"
    unit = tuned.units.get(term, "")
    return [
        (str(name), shown_value(float(one), unit), shown_value(float(other), unit))
        for name, one, other in zip(after.terms.index, before.terms[term], after.terms[term], strict=True)
    ]


def _setting(value: Any) -> str:
    if isinstance(value, dict):
        return ", ".join(f"{words(str(name))} {_setting(each)}" for name, each in value.items()) or "none"
    if isinstance(value, list):
        return ", ".join(map(_setting, value)) or "none"
    return "none" if value is None else f"{value:.6g}" if isinstance(value, float) else str(value)
