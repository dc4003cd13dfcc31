"""Readings of a machine with what effects in its sensors add to them, on any rig."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from jaxtyping import Array

from jaxmuscle.effects.base import States
from jaxmuscle.effects.chain import filled
from jaxmuscle.signals import POSITION_READING, PRESSURE_READING, Signals, Slot

if TYPE_CHECKING:
    from jaxmuscle.actuators.variables import Column


def reading_slots(
    outputs: Mapping[str, tuple[str, ...]], columns: Mapping[str, Column], motion: str | None
) -> dict[Slot, str]:
    """Slot of a reading → the output that it is: pressures against ambient or vacuum, and the motion.

    Of several outputs of one kind the first. The force has its slot in the chain of each rig.

    Args:
        motion: unit of the rig's motion.
    """
    found: dict[Slot, str] = {}
    for output, names in outputs.items():
        column = columns.get(names[0])
        if column is None:
            continue
        if column.referenced:
            found.setdefault(PRESSURE_READING, output)
        elif column.unit == motion:
            found.setdefault(POSITION_READING, output)
    return found


def sensing(actuator: Any, signals: Signals) -> Signals:
    """`signals` with what the sensors are loaded with, for those whose effects the machine carries."""
    slots = _carried(actuator)
    if not slots:
        return signals
    true = actuator.readings(signals)
    return signals.having(**{slot.name: true[output] for slot, output in slots.items()})


def sensed(actuator: Any, signals: Signals, states: States) -> dict[str, Array]:
    """The machine's readings, with what effects in its sensors add.

    Args:
        states: integrated states and memories of effects.
    """
    true, slots = actuator.readings(signals), _carried(actuator)
    if not slots:
        return true
    loaded = signals.having(**{slot.name: true[output] for slot, output in slots.items()})
    shown = {
        output: getattr(filled(actuator.effects, slot, true[output], states, loaded), slot.name)
        for slot, output in slots.items()
    }
    return {**true, **shown}


def _carried(actuator: Any) -> dict[Slot, str]:
    """The slots of readings for which the machine carries effects, and their outputs."""
    carried = {effect.slot for effect in actuator.effects.values()}
    if carried.isdisjoint((PRESSURE_READING, POSITION_READING)):
        return {}
    return {slot: output for slot, output in actuator.reading_slots().items() if slot in carried}
