"""Effects in the chain of a machine: slots filled with what they add, their states and memories."""

from __future__ import annotations

from typing import Any

from jaxtyping import Array

from jaxmuscle.effects.base import (
    AbstractEffect,
    AbstractFrictionEffect,
    AbstractMemoryEffect,
    AbstractMuscleEffect,
    AbstractRateEffect,
    AbstractSlipEffect,
    AbstractStaticEffect,
    AbstractTransmissionEffect,
    AbstractWallEffect,
    Effects,
    States,
)
from jaxmuscle.signals import Signals, Slot

_ELSEWHERE = (AbstractFrictionEffect, AbstractMuscleEffect, AbstractTransmissionEffect, AbstractSlipEffect)
"""Effects that do not add to their slot as the chain fills it."""
_WITH_STATE = (AbstractRateEffect, AbstractMemoryEffect)


def filled(effects: Effects, slot: Slot, value: Array, states: States, signals: Signals) -> Signals:
    """`signals` with the slot filled by `value` and by what its effects add to it, stage by stage.

    Dry friction is left to the machine, which knows what the motion calls for: :func:`friction_limit`;
    what alters muscles or sprockets acts before: :func:`altered_muscle`,
    :func:`jaxmuscle.effects.transmission.arms`.
    """
    acting = {n: e for n, e in effects.items() if e.slot == slot and not isinstance(e, _ELSEWHERE)}
    signals = signals.having(**{slot.name: value})
    for stage in sorted({effect.stage for effect in acting.values()}):
        found = getattr(signals, slot.name)
        total: Array | float = 0.0
        for name, effect in acting.items():
            if effect.stage == stage:
                total = total + effect_value(effect, states.get(name), signals)
        here = {n: found for n, e in acting.items() if e.stage == stage and isinstance(e, _WITH_STATE)}
        signals = signals.having(**{slot.name: found + total}, found={**signals.found, **here})
    return signals


def effect_value(effect: AbstractEffect, state: Any, signals: Signals) -> Array:
    """The addition of one effect other than dry friction, with or without a state."""
    if isinstance(effect, AbstractStaticEffect):
        return effect.value(signals)
    assert isinstance(effect, AbstractRateEffect | AbstractMemoryEffect)
    return effect.value(state, signals)


def chamber(effects: Effects, muscle: Any, contraction: Array) -> tuple[Array, Array]:
    """Volume within a muscle's wall [m^3], and its slope over the contraction [m^2]."""
    volume, slope = muscle.volume(contraction), muscle.volume_slope(contraction)
    for effect in effects.values():
        if isinstance(effect, AbstractWallEffect):
            room, growth = effect.room(muscle, contraction)
            volume, slope = volume - room, slope - growth
    return volume, slope


def altered_muscle(effects: Effects, muscle: Any) -> Any:
    """The muscle component after all effects that alter it."""
    for effect in effects.values():
        if isinstance(effect, AbstractMuscleEffect):
            muscle = effect.altered(muscle)
    return muscle


def _as_found(name: str, effect: AbstractEffect, signals: Signals) -> Signals:
    """The signals of a whole chain as an effect with a state found them: its slot before it acted."""
    return signals.having(**{effect.slot.name: signals.found[name]}) if name in signals.found else signals


def initial_states(effects: Effects, signals: Signals) -> tuple[dict[str, Any], dict[str, Any]]:
    """(integrated states, memories) of all effects at rest under `signals`."""
    rates, memories = (
        {n: e.initial(_as_found(n, e, signals)) for n, e in effects.items() if isinstance(e, kind)}
        for kind in _WITH_STATE
    )
    return rates, memories


def state_rates(effects: Effects, states: States, signals: Signals) -> dict[str, Any]:
    """Time derivatives of all integrated effect states."""
    return {
        n: e.rate(states[n], _as_found(n, e, signals))
        for n, e in effects.items()
        if isinstance(e, AbstractRateEffect)
    }


def updated_memories(effects: Effects, memories: States, signals: Signals, step: Array) -> dict[str, Any]:
    """All memories after a solver step of `step` seconds that ended with `signals`."""
    return {
        n: e.update(memories[n], _as_found(n, e, signals), step)
        for n, e in effects.items()
        if isinstance(e, AbstractMemoryEffect)
    }
