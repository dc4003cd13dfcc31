"""Outcome of a tuning: gains, what they bring on the scenarios that were tuned on and on those held out."""

from __future__ import annotations

import dataclasses
import math
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import equinox as eqx
import pandas as pd
from matplotlib.figure import Figure

import jaxmuscle
from jaxmuscle.control.feedback import Attached
from jaxmuscle.errors import InputError
from jaxmuscle.estimation.serialization import as_toml, plain, restored, table
from jaxmuscle.files import atomic_write, existing_file, file_content
from jaxmuscle.formatting import aligned, quantity, rounded
from jaxmuscle.notebook_html import Sparkline, Table, View
from jaxmuscle.tuning.figure import plot
from jaxmuscle.tuning.gains import movable
from jaxmuscle.tuning.scenario_costs import Gain, Judged
from jaxmuscle.tuning.trace_files import read_traces, write_traces


@dataclasses.dataclass(frozen=True)
class Tuning:
    """The outcome of :func:`jaxmuscle.tune`.

    Attributes:
        gains: name → tuned gain.
        before, after: on the training scenarios, with the start gains and with the tuned ones.
        held_out_before, held_out_after: on those that took no part; `None` without any.
        units: term → SI unit.
        code: "converged", "stalled" (no step lowers the cost any more), "steps" or "budget" (best so far).
        notes: what a reader has to know, one sentence each.
        traces: scenario → table over time: reference, reading and commands before and after, of the worst
            training scenario and the worst one held out, as they are with the tuned gains; none in a result
            that was loaded without them.
        settings: what :func:`jaxmuscle.tune` was asked for.
        evaluations, seconds: points at which cost and derivatives were computed; the whole took.
        controller: the tuned controller, of the kind that was given; `None` in a result that was loaded, see
            :meth:`put_into`.
    """

    gains: dict[str, Gain]
    before: Judged
    after: Judged
    held_out_before: Judged | None
    held_out_after: Judged | None
    units: dict[str, str]
    code: str
    notes: tuple[str, ...]
    traces: dict[str, pd.DataFrame]
    settings: dict[str, Any]
    evaluations: int
    seconds: float
    controller: Any = None

    @property
    def values(self) -> dict[str, float]:
        """Name → tuned value (SI)."""
        return {name: gain.value for name, gain in self.gains.items()}

    @property
    def holds(self) -> bool | None:
        """Whether the cost fell on the held-out scenarios too; `None` without any."""
        if self.held_out_before is None or self.held_out_after is None:
            return None
        return self.held_out_after.cost < self.held_out_before.cost

    def put_into(self, controller: Any) -> Any:
        """A controller of the same kind with the tuned gains; one that is attached stays so.

        Raises:
            InputError: it has no gain of some name.
        """
        inner = controller.controller if isinstance(controller, Attached) else controller
        tuned = movable(inner, list(self.gains)).at(list(self.values.values()))
        if isinstance(controller, Attached):
            return eqx.tree_at(lambda loop: loop.controller, controller, tuned)
        return tuned

    def table(self) -> pd.DataFrame:
        """Gain, value, start, unit, bounds and sensitivities, one row a gain."""
        rows = {name: dataclasses.asdict(gain) for name, gain in self.gains.items()}
        return pd.DataFrame.from_dict(rows, orient="index").rename_axis("gain")

    def __str__(self) -> str:
        """Cost, gains and terms before and after, notes."""
        return summary(self)

    __repr__ = __str__

    def _repr_html_(self) -> str:
        """What a notebook shows: gains, terms, references with readings, notes."""
        return _view(self).html()

    def plot(self) -> Figure:
        """A matplotlib figure: the worst scenarios before and after, their commands, all terms.

        Without traces the terms alone.
        """
        sides = {"training": (self.before, self.after)}
        if self.held_out_before is not None and self.held_out_after is not None:
            sides["held out"] = self.held_out_before, self.held_out_after
        return plot(self.traces, self.units, sides)

    def save(self, path: str | Path, traces: bool = False) -> Path:
        """Write gains, sensitivities, terms, notes and settings as TOML; :meth:`load` reads them back.

        Args:
            path: the file, ``gains.toml``.
            traces: write the traces too, beside it, ``gains.npz``.
        """
        file = Path(path)
        beside = [file.with_suffix(TRACES)] if traces else []
        with atomic_write(file, *beside) as (unfinished, *others):
            unfinished.write_text(self.to_toml(traces), encoding="utf-8", newline="\n")
            for other in others:
                write_traces(other, self.traces)
        return file

    def to_toml(self, traces: bool = False) -> str:
        """What :meth:`save` writes; `traces`: whether they stand beside it."""
        apart = ("controller", "traces")
        fields = {f.name: getattr(self, f.name) for f in dataclasses.fields(self) if f.name not in apart}
        content = {"kind": KIND, "format": FORMAT, "jaxmuscle": jaxmuscle.__version__, "has_traces": traces}
        return as_toml(content | {name: plain(value) for name, value in fields.items()})

    @classmethod
    def load(cls, path: str | Path) -> Tuning:
        """A result as it was saved, without its controller; with its traces if they are beside it.

        Raises:
            InputError: no such file, or not a saved tuning.
        """
        return _loaded(Path(path))


KIND = "jaxmuscle tuning"
FORMAT = 2
"""Of files; 1 held the traces in the TOML, and no settings."""
READABLE = (1, 2)
TRACES = ".npz"
"""Ending of a file of traces."""


def _loaded(path: Path) -> Tuning:
    file = existing_file(path, "saved tuning", (".toml",))
    try:
        content = tomllib.loads(file_content(file).decode("utf-8"))
    except ValueError as error:
        raise InputError(f"{file}: cannot be read as TOML: {error}") from error
    if content.get("kind") != KIND:
        raise InputError(f"{file}: not a tuning; expected a file that Tuning.save wrote")
    if content["format"] not in READABLE:
        raise InputError(
            f"{file}: written by jaxmuscle {content['jaxmuscle']}, whose files differ; tune again"
        )
    data = restored(content)

    def judged(name: str) -> Any:
        own = data[name]
        return None if own is None else Judged(own["cost"], table(own["terms"]))

    return Tuning(
        gains={name: Gain(**gain) for name, gain in data["gains"].items()},
        before=judged("before"),
        after=judged("after"),
        held_out_before=judged("held_out_before"),
        held_out_after=judged("held_out_after"),
        notes=tuple(data["notes"]),
        traces=_traces(file, data),
        settings=data.get("settings", {}),
        **{name: data[name] for name in ("units", "code", "evaluations", "seconds")},
    )


def _traces(file: Path, data: Mapping[str, Any]) -> dict[str, pd.DataFrame]:
    """The traces within a file of the first format, or those beside it, if they are still there."""
    if "traces" in data:
        return {name: table(each) for name, each in data["traces"].items()}
    beside = file.with_suffix(TRACES)
    return read_traces(beside) if data["has_traces"] and beside.is_file() else {}


def summary(tuned: Tuning) -> str:
    """A result as text."""
    lines = [_headline(tuned), "", aligned(GAINS, _gain_rows(tuned)[:MOST_SHOWN])]
    if len(tuned.gains) > MOST_SHOWN:
        lines.append(f"and {len(tuned.gains) - MOST_SHOWN} others")
    if tuned.units:
        lines += ["", aligned(*_terms(tuned))]
    return "\n".join([*lines, *(["", *tuned.notes] if tuned.notes else [])])


def _view(tuned: Tuning) -> View:
    heads, terms = _terms(tuned)
    traces = [(name, *_traced(table)) for name, table in tuned.traces.items()]
    return View(
        "tuning",
        f"{len(tuned.gains)} gains",
        badge="" if tuned.holds is None else "holds on unseen" if tuned.holds else "does not hold on unseen",
        mood="good" if tuned.holds else "doubt",
        lead=[_headline(tuned)],
        tables=[
            Table("gains", GAINS, _gain_rows(tuned), open=len(tuned.gains) <= MOST_SHOWN),
            Table("terms", heads, terms),
            Table("worst scenarios: reference and reading", ("", "before", "after"), traces),
        ],
        notes=tuned.notes,
    )


def _traced(table: pd.DataFrame) -> list[Sparkline]:
    """Reference and first reading before the tuning, and after it."""
    reference = [table[name] for name in table if str(name).startswith("reference")][:1]
    readings = [name for name in table if not str(name).startswith(("reference", "command"))]
    firsts = (next(name for name in readings if str(name).endswith(when)) for when in ("before", "after"))
    return [Sparkline(*reference, table[name]) for name in firsts]


GAINS = ("gain", "before", "after", "unit", "cost at -10 %", "at +10 %")


def _headline(tuned: Tuning) -> str:
    """Costs before and after, and how it ended."""
    line = f"Cost {_costs(tuned.before, tuned.after)} on {len(tuned.after.terms)} training scenarios"
    before, after = tuned.held_out_before, tuned.held_out_after
    if before is not None and after is not None:
        line += f", {_costs(before, after)} on {len(after.terms)} held-out ones"
    return f"{line} ({tuned.code}; {tuned.evaluations} evaluations with derivatives, {tuned.seconds:.1f} s)."


def _gain_rows(tuned: Tuning) -> list[tuple[str, ...]]:
    return [
        (
            name,
            rounded(gain.start, 4),
            rounded(gain.value, 4),
            gain.unit,
            shown_rise(gain.less),
            shown_rise(gain.more),
        )
        for name, gain in tuned.gains.items()
    ]


def _terms(tuned: Tuning) -> tuple[tuple[str, ...], list[tuple[str, ...]]]:
    """Heads and rows of the table of terms."""
    four = (tuned.before, tuned.after, tuned.held_out_before, tuned.held_out_after)
    sides = [side for side in four if side is not None]
    heads = ("term", "training before", "after", "held-out before", "after")[: len(sides) + 1]
    rows = [(t, *(shown_value(side.value(t), unit) for side in sides)) for t, unit in tuned.units.items()]
    return heads, rows


ROUNDING = 1e-12
"""Value of a term (SI) that is printed as none."""
MOST_SHOWN = 12
"""Gains that the text lists; the table has all of them."""


def shown_value(value: float, unit: str) -> str:
    """The value of a term, without what rounding leaves of none."""
    if not math.isfinite(value):
        return "not finite"
    return quantity(0.0 if abs(value) < ROUNDING else value, unit, 3)


def _costs(before: Judged, after: Judged) -> str:
    return f"{rounded(before.cost, 3)} to {rounded(after.cost, 3)}"


def shown_rise(share: float) -> str:
    """A relative rise of the cost as printed."""
    return f"{100 * share:+.1f} %" if math.isfinite(share) else "-"
