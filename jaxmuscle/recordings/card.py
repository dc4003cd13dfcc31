"""Card of a recording: how it was made, in SI, from TOML and back."""

from __future__ import annotations

import dataclasses
import math
import tomllib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from jaxmuscle.actuators import rig_named
from jaxmuscle.actuators.actuator import AbstractActuator
from jaxmuscle.effects import is_registered
from jaxmuscle.effects.base import AbstractEffect
from jaxmuscle.errors import InputError, nearest
from jaxmuscle.files import existing_file, file_content
from jaxmuscle.parameter_names import effect_path, resolve, spelled
from jaxmuscle.recordings import schema
from jaxmuscle.recordings.card_rows import BREAKS, HELD_OUT, IGNORE, RowSpan, written_row_span
from jaxmuscle.recordings.card_sections import BOTH, read_sections
from jaxmuscle.recordings.data_sheets import sheet_quantities
from jaxmuscle.recordings.schema import (
    AMBIENT,
    ColumnSpec,
    Need,
    Quantity,
    written_deviation,
    written_quantity,
)
from jaxmuscle.recordings.toml_documents import edited_text, toml_text
from jaxmuscle.units import STANDARD_ATMOSPHERE

Estimate = tuple[float, float | None]
"""A value and its standard deviation (SI), `None` when it is not uncertain."""


@dataclasses.dataclass(frozen=True)
class Card:
    """What the experimenter declares about a recording. Values are SI, pressures absolute.

    Attributes:
        rig: name of the machine, a key of `jaxmuscle.actuators.RIGS`.
        columns: quantity → where it stands in the table.
        known, uncertain: quantity → value; those with a standard deviation are the uncertain ones,
            whichever section they were written in, and those that the data sheets of the parts give.
        description: free text.
        effects: name of an effect that the experimenter declares → parameter → value.
        noise: measured quantity → standard deviation of its sensor [SI].
        horizon: length of the windows of prediction [s], `None` for whole runs.
        state_from: by which samples the state is told from which a window begins: those of ``"both"`` sides,
            or of the ``"past"`` alone, which is what a controller knows that predicts.
        ignore: name of the user's → rows whose readings count for nothing (a slack muscle, a saturated
            sensor).
        held_out: name → rows that no fit of a diagnosis sees.
        breaks: name → where a new run begins, with everything that is not measured at rest.
        parts: muscle or valve → its type, whose data sheet gives the quantities that the card does not give.
        file: where the card came from, when it did; not part of what makes two cards equal.
        text: the TOML that it was read from, of which :meth:`to_toml` keeps the comments and the layout;
            not part of what makes two cards equal.
    """

    rig: str
    columns: dict[str, ColumnSpec]
    known: dict[str, Quantity]
    uncertain: dict[str, Quantity]
    description: str = ""
    effects: dict[str, dict[str, Quantity]] = dataclasses.field(default_factory=dict)
    noise: dict[str, float] = dataclasses.field(default_factory=dict)
    horizon: float | None = None
    state_from: str = BOTH
    ignore: dict[str, RowSpan] = dataclasses.field(default_factory=dict)
    held_out: dict[str, RowSpan] = dataclasses.field(default_factory=dict)
    breaks: dict[str, RowSpan] = dataclasses.field(default_factory=dict)
    parts: dict[str, str] = dataclasses.field(default_factory=dict)
    file: Path | None = dataclasses.field(default=None, compare=False)
    text: str | None = dataclasses.field(default=None, compare=False, repr=False)

    @classmethod
    def read(cls, path: str | Path) -> Card:
        """The card in a TOML file. `InputError` names the file and everything that is wrong with it."""
        file = existing_file(Path(path), "card", (".toml",))
        try:
            return cls.from_toml(file_content(file).decode("utf-8-sig"), file)
        except UnicodeDecodeError as error:
            raise InputError(f"{file}: not a text in UTF-8 (byte {error.start}); save it as UTF-8") from error

    @classmethod
    def from_toml(cls, text: str, file: Path | None = None) -> Card:
        """The card in a TOML text. `InputError` tells everything that is wrong with it."""
        try:
            mapping = tomllib.loads(text)
        except (ValueError, RecursionError) as error:  # Numbers of 5000 digits, brackets 1000 deep.
            where = "card" if file is None else file
            raise InputError(f"{where}: cannot be read as TOML: {error}") from error
        return dataclasses.replace(cls.parse(mapping, file=file), text=text)

    @classmethod
    def parse(cls, mapping: Mapping[str, Any], file: Path | None = None) -> Card:
        """The card in a mapping as `tomllib` gives it. `InputError` tells everything that is wrong."""
        return cls(**read_sections(mapping, "card" if file is None else str(file)), file=file)

    @property
    def quantities(self) -> dict[str, Quantity]:
        """The known and the uncertain quantities together."""
        return {**self.known, **self.uncertain}

    @property
    def entries(self) -> dict[str, Quantity]:
        """The quantities and the parameters of declared effects, by the names that results call them."""
        effects = ((effect_path(e, name), q) for e, own in self.effects.items() for name, q in own.items())
        return {**self.quantities, **dict(effects)}

    @property
    def sheet_quantities(self) -> frozenset[str]:
        """The quantities that are what the data sheets of the card's parts give."""
        rig, given = rig_named(self.rig), self.quantities
        sheets = [sheet_quantities(rig, part, kind) for part, kind in self.parts.items()]
        return frozenset(name for sheet in sheets for name, q in sheet.items() if given.get(name) == q)

    @property
    def row_spans(self) -> dict[str, dict[str, RowSpan]]:
        """Section → name → rows, of the sections that name rows."""
        return {IGNORE: self.ignore, HELD_OUT: self.held_out, BREAKS: self.breaks}

    @property
    def ambient_pressure(self) -> float:
        """Absolute pressure to which the card's gauge pressures are relative [Pa]."""
        given = self.quantities.get(AMBIENT)
        return STANDARD_ATMOSPHERE if given is None else given.value

    def updated(
        self,
        values: Mapping[str, Estimate] | None = None,
        effects: Mapping[str, Mapping[str, Estimate]] | None = None,
    ) -> Card:
        """A copy with new values for quantities and for parameters of effects, declared before or not.

        Args:
            values: quantity of the card, by any of its names → estimate (SI, pressures absolute). With a
                standard deviation it becomes uncertain, without one it becomes known.
            effects: effect → parameter → estimate; parameters that are not named stay as they are.

        Raises:
            InputError: a name of no quantity of the rig, or two of one.
            ValueError: an estimate that could not be read back: not finite, or a standard deviation that
                is not positive.
        """
        rig = rig_named(self.rig)
        known, uncertain, declared = dict(self.known), dict(self.uncertain), dict(self.effects)
        named: set[str] = set()
        for written, estimate in (values or {}).items():
            name = resolve(spelled(rig.quantities), written, "card", "no quantity {}")
            if name in named:
                raise InputError(f"card: {name!r} is given twice, also as {written!r}; keep one")
            named.add(name)
            quantity = _estimated(name, self.quantities.get(name), schema.quantities(rig), estimate)
            here, there = (known, uncertain) if quantity.std is None else (uncertain, known)
            here[name] = quantity
            there.pop(name, None)
        for effect, parameters in (effects or {}).items():
            needs = schema.effect_parameters(rig.effect_named(effect), rig)
            old = self.effects.get(effect, {})
            new = {name: _estimated(name, old.get(name), needs, e) for name, e in parameters.items()}
            declared[effect] = {**old, **new}
        return dataclasses.replace(self, known=known, uncertain=uncertain, effects=declared, file=None)

    def telling(self, told: Sequence[str]) -> Card:
        """A copy whose description also tells what a card has no place for, `told`; itself if nothing."""
        if not told:
            return self
        text = f"{self.description} Fitted beside it, not part of this card: {', '.join(told)}."
        return dataclasses.replace(self, description=text.strip(), file=None)

    def to_toml(self) -> str:
        """The card as TOML, in the units in which it was written; it reads back as an equal card.

        Of a card that was read, and whatever was updated since, comments, order and everything that did not
        change stay as they were written.
        """
        heads = {"rig": self.rig, "description": self.description}
        if self.text is None:
            return toml_text(heads, self._sections({}))
        mapping = tomllib.loads(self.text)
        before = Card.parse(mapping)
        standing = {name: section for section in ("known", "uncertain") for name in mapping.get(section, {})}
        told = {"rig": (before.rig, self.rig), "description": (before.description, self.description)}
        return edited_text(self.text, told, before._sections(standing), self._sections(standing))

    def _sections(self, standing: Mapping[str, str]) -> dict[str, dict[str, Any]]:
        """The entries of every section.

        Args:
            standing: name of a quantity → section in which it stands. One with a standard deviation may
                stand among the known ones. What stands nowhere and is as its data sheet has it is left to it.
        """
        rig, ambient = rig_named(self.rig), self.ambient_pressure
        needs, columns = schema.quantities(rig), schema.columns(rig)

        def written(quantities: Mapping[str, Quantity], needs: Mapping[str, Need]) -> dict[str, Any]:
            return {name: written_quantity(q, needs[name], ambient) for name, q in quantities.items()}

        given = {n: q for n, q in self.quantities.items() if n in standing or n not in self.sheet_quantities}
        uncertain = {n: q for n, q in given.items() if n in self.uncertain and standing.get(n) != "known"}
        known = {n: q for n, q in given.items() if n not in uncertain}
        sections: dict[str, dict[str, Any]] = {
            "columns": {name: _written_column(spec) for name, spec in self.columns.items()},
            **{part: {"type": kind} for part, kind in self.parts.items()},
            "known": written(known, needs),
            "uncertain": written(uncertain, needs),
            "noise": {name: self._written_noise(name, columns[name]) for name in self.noise},
        }
        if self.horizon is not None:
            sections["fit"] = {"horizon": {"value": self.horizon, "unit": "s"}}
        if self.state_from != BOTH:
            sections["fit"] = {**sections.get("fit", {}), "state_from": self.state_from}
        for name, parameters in self.effects.items():
            own = schema.effect_parameters(rig.effect_named(name), rig)
            sections[f"effects.{name}"] = written(parameters, own)
        for name, spans in self.row_spans.items():
            if spans:
                sections[name] = {key: written_row_span(name, span) for key, span in spans.items()}
        return sections

    def _written_noise(self, name: str, need: Need) -> dict[str, Any]:
        unit = self.columns[name].unit
        return {"value": written_deviation(self.noise[name], unit, need), "unit": unit}


def actuator_from_card(card: Card) -> AbstractActuator:
    """The machine that a card describes, with the effects that it declares.

    Raises:
        InputError: the card is of a rig that is not registered.
    """
    rig = rig_named(card.rig)
    values = {rig.quantities[name]: quantity.value for name, quantity in card.quantities.items()}
    effects = {name: _effect(rig.effect_named(name), parameters) for name, parameters in card.effects.items()}
    return schema.build(rig, values, effects)


def can_declare(name: str, effect: AbstractEffect) -> bool:
    """Whether a card can hold an effect: of a class that has this name for cards, and without arrays."""
    values = [getattr(effect, f.name) for f in dataclasses.fields(effect) if "unit" in f.metadata]
    return is_registered(name, effect) and all(np.ndim(value) == 0 for value in values)


def _effect(kind: Any, parameters: Mapping[str, Quantity]) -> AbstractEffect:
    return kind(**{parameter: quantity.value for parameter, quantity in parameters.items()})


def _estimated(name: str, old: Quantity | None, needs: Mapping[str, Need], estimate: Estimate) -> Quantity:
    """The estimate as an entry of a card, in the unit of the one it replaces."""
    if name not in needs:
        raise ValueError(f"no quantity {name!r} to update{nearest(name, needs)}")
    value, std = float(estimate[0]), None if estimate[1] is None else float(estimate[1])
    if not math.isfinite(value) or (std is not None and not 0 < std < math.inf):
        raise ValueError(f"{name}: expected a finite value and a positive finite std or None; got {estimate}")
    need = needs[name]
    before = old or Quantity(value, None, need.unit, "absolute" if need.referenced else None)
    return dataclasses.replace(before, value=value, std=std)


def _written_column(spec: ColumnSpec) -> dict[str, str]:
    return {key: text for key, text in dataclasses.asdict(spec).items() if text is not None}
