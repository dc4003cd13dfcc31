"""Effects of a user's own, by name."""

from typing import ClassVar

import pytest
from effects.own import Sleeve

import jaxmuscle as jm
from jaxmuscle import InputError
from jaxmuscle.effects import (
    ALTERNATIVE_FORMS,
    BY_NAME,
    CATALOGUE,
    FURTHER,
    AbstractStaticEffect,
    LoadFriction,
)
from jaxmuscle.parameters import Scalar, parameter


@pytest.fixture(autouse=True)
def _as_before():
    known = dict(BY_NAME)
    yield
    BY_NAME.clear()
    BY_NAME.update(known)


def test_the_effects_of_the_package_are_registered():
    assert set(BY_NAME.values()) == {*CATALOGUE, *ALTERNATIVE_FORMS, *FURTHER}
    assert all(effect.name == name for name, effect in BY_NAME.items())


def test_registered_twice_and_never_sought_by_itself():
    assert jm.effects.register(Sleeve) is Sleeve
    assert jm.effects.register(Sleeve) is Sleeve
    assert BY_NAME["own_sleeve"] is Sleeve and Sleeve not in CATALOGUE


def named(**variables):
    """A variant of the sleeve with other class variables."""
    return type("Variant", (Sleeve,), {"__annotations__": {}, **variables})


@pytest.mark.parametrize(
    ("effect", "told"),
    [
        (named(name="load_friction"), "the name 'load_friction' is that of LoadFriction"),
        (named(name="own sleeve"), "a name of letters, digits and underscores; got 'own sleeve'"),
        (named(strength="gain"), r"one of its parameters \(stiffness\) as strength; got 'gain'"),
        (AbstractStaticEffect, "expected class variables name, slot, reads, strength, starts, source"),
    ],
)
def test_what_cannot_be_registered(effect, told):
    with pytest.raises(InputError, match=told):
        jm.effects.register(effect)
    assert set(BY_NAME.values()) == {*CATALOGUE, *ALTERNATIVE_FORMS, *FURTHER}


def test_an_abstract_class_is_refused():
    class Half(AbstractStaticEffect):
        """Does not say what it adds."""

        name: ClassVar = "half"
        slot: ClassVar = LoadFriction.slot
        reads: ClassVar = frozenset()
        strength: ClassVar = "gain"
        starts: ClassVar = ({},)
        source: ClassVar = "test"

        gain: Scalar = parameter("N", "size", default=0.0)

    with pytest.raises(InputError, match="Half: still abstract; define value"):
        jm.effects.register(Half)


def test_a_card_can_declare_it(tmp_path):
    text = jm.sample("bench").with_suffix(".toml").read_text(encoding="utf-8")
    text += '\n[effects.own_sleeve]\nstiffness = { value = 40, std = 5, unit = "N/mm^2" }\n'
    (tmp_path / "bench.toml").write_text(text, encoding="utf-8")
    with pytest.raises(InputError, match=r"unknown effect.*jaxmuscle\.effects\.register"):
        jm.Card.read(tmp_path / "bench.toml")
    jm.effects.register(Sleeve)
    card = jm.Card.read(tmp_path / "bench.toml")
    machine = jm.actuator(card)
    assert machine.effects["own_sleeve"] == Sleeve(stiffness=4e7)  # pyright: ignore
    (tmp_path / "again.toml").write_text(card.to_toml(), encoding="utf-8")
    assert jm.Card.read(tmp_path / "again.toml") == card
