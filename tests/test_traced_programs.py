"""Traces that are kept for later processes: found again, told apart, and never an obstacle."""

import dataclasses
from functools import partial
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxmuscle as jm
from jaxmuscle import _compilation_cache
from jaxmuscle._traced_programs import KeptProgram, UnknownCodeError, _pieces
from jaxmuscle.components import McKibben
from jaxmuscle.errors import InputError

SIZES: Any = {"initial_length": 0.3, "initial_radius": 0.01, "braid_angle": 0.4, "end_factor": 1.28}
MUSCLE = McKibben(**SIZES)


class Counted:
    """A function of a muscle and a pressure, as a process would begin with it, and how often it is traced."""

    def __init__(self):
        self.traced = 0

        def force(muscle, pressure, scale):
            self.traced += 1
            return {
                "force": scale * muscle.force(0.1, pressure, muscle.end_factor),
                "parts": (pressure, scale * pressure),
            }

        force.__qualname__ = "force"
        self.kept = KeptProgram(force)

    def __call__(self, *args):
        return self.kept(*args)


@pytest.fixture
def folder(tmp_path):
    """The folder that the package keeps programs in, for one test, whatever these tests were given for it."""
    names = ("jax_enable_compilation_cache", "jax_compilation_cache_dir")
    before = {name: getattr(jax.config, name) for name in names}
    jax.config.update("jax_enable_compilation_cache", True)
    jax.config.update("jax_compilation_cache_dir", None)
    jm.configure(compile_cache=tmp_path)
    yield tmp_path
    jm.configure(compile_cache=False)
    for name, value in before.items():
        jax.config.update(name, value)


def traces(folder):
    return sorted(folder.glob(f"*{_compilation_cache.TRACE}"))


def muscle(**changes):
    return dataclasses.replace(MUSCLE, **{k: jnp.asarray(v) for k, v in changes.items()})


def test_a_later_process_does_not_trace(folder):
    first, later = Counted(), Counted()
    found = [each(muscle(initial_radius=0.01), jnp.linspace(0, 5e5, 7), 2.0) for each in (first, later)]
    assert (first.traced, later.traced) == (1, 0) and len(traces(folder)) == 1
    np.testing.assert_array_equal(found[0]["force"], found[1]["force"])
    # Nor is it traced for other values of the same shapes.
    other = later(muscle(initial_radius=0.02), jnp.linspace(0, 5e5, 7), 2.0)
    assert later.traced == 0
    expected = first.kept.plain(muscle(initial_radius=0.02), jnp.linspace(0, 5e5, 7), 2.0)
    np.testing.assert_allclose(other["force"], expected["force"])
    assert other["parts"][1].shape == (7,)


@pytest.mark.parametrize(
    "args",
    [
        (muscle(initial_radius=0.01), jnp.ones(3), 2.0),
        (muscle(initial_radius=0.01), jnp.ones(7, dtype=jnp.float32), 2.0),
        (muscle(initial_radius=0.01), jnp.ones(7), 3.0),
        (muscle(initial_radius=0.01), jnp.ones(7), 2),
    ],
    ids=["shape", "precision", "number", "kind of number"],
)
def test_what_changes_a_program_is_told_apart(folder, args):
    first, other = Counted(), Counted()
    first(muscle(initial_radius=0.01), jnp.ones(7), 2.0)
    found = other(*args)
    assert other.traced == 1 and len(traces(folder)) == 2
    np.testing.assert_allclose(found["force"], other.kept.plain(*args)["force"])


def test_other_code_of_the_package_is_told_apart(folder, monkeypatch):
    first, other = Counted(), Counted()
    first(MUSCLE, jnp.ones(7), 2.0)
    monkeypatch.setattr("jaxmuscle._traced_programs.package_hash", lambda: "another release")
    other(MUSCLE, jnp.ones(7), 2.0)
    assert other.traced == 1 and len(traces(folder)) == 2


class OwnMuscle(McKibben):
    """A class of a user's, whose code may be another one in the next process."""


@pytest.mark.parametrize(
    "thing",
    [
        OwnMuscle(**SIZES),
        lambda x: x,
        {1: OwnMuscle},
        object(),
    ],
    ids=["class", "lambda", "in a dict", "object"],
)
def test_code_of_ones_own_is_not_kept(folder, thing):
    with pytest.raises(UnknownCodeError):
        list(_pieces(thing))
    times = []

    def function(_, x):
        times.append(1)
        return 2 * x

    kept = KeptProgram(function)
    assert kept(thing, jnp.ones(2)).tolist() == [2.0, 2.0] == kept(thing, jnp.ones(2)).tolist()
    assert not traces(folder) and len(times) == 1


def test_functions_and_settings_of_the_package_are_told_by_name():
    def pieces(function, names):
        return list(
            _pieces((function, partial(np.linspace, 1.0), frozenset(names), McKibben, (None, True, 1e-3)))
        )

    assert pieces(jnp.sin, {"b", "a"}) == pieces(jnp.sin, {"a", "b"}) != pieces(jnp.cos, {"b", "a"})
    assert pieces(jnp.sin, {"b", "a"}) != pieces(jnp.sin, {"b", "c"})


@pytest.mark.parametrize("damage", [b"", b"nothing that was ever kept", None], ids=["empty", "other", "cut"])
def test_a_damaged_trace_is_taken_anew(folder, damage):
    Counted()(MUSCLE, jnp.ones(7), 2.0)
    (file,) = traces(folder)
    whole = file.read_bytes()
    file.write_bytes(whole[:-9] if damage is None else damage)
    later, last = Counted(), Counted()
    later(MUSCLE, jnp.ones(7), 2.0)
    last(MUSCLE, jnp.ones(7), 2.0)
    assert (later.traced, last.traced) == (1, 0)


def test_without_a_folder_it_is_the_plain_program(tmp_path):
    kept = Counted()
    kept(MUSCLE, jnp.ones(7), 2.0)
    assert kept.traced == 1 and not list(tmp_path.iterdir())


def test_a_folder_that_takes_nothing_is_no_obstacle(folder, monkeypatch):
    def refuse(*_):
        raise InputError("no space left")

    monkeypatch.setattr("jaxmuscle._traced_programs.atomic_write", refuse)
    kept = Counted()
    assert np.isfinite(kept(MUSCLE, jnp.ones(7), 2.0)["force"]).all() and not traces(folder)


def test_derivatives_go_through(folder):
    kept = Counted()
    slope = jax.grad(lambda p: kept(MUSCLE, p, 2.0)["force"])(2e5)
    assert slope == pytest.approx(
        2 * float(MUSCLE.force(jnp.array(0.1), jnp.array(1.0), MUSCLE.end_factor)), rel=1e-6
    )


def test_errors_are_those_of_the_function(folder):
    @KeptProgram
    def failing(x):
        raise ValueError("a muscle longer than its bench")

    with pytest.raises(ValueError, match="longer than its bench"):
        failing(jnp.ones(2))


def test_what_is_traced_is_traced_with_equinox_rules(folder):
    """Numbers of Python are part of the program, those of NumPy are its inputs."""
    assert eqx.is_array_like(np.float64(1.0))
    kept = Counted()
    kept(MUSCLE, np.ones(7), 2.0)
    kept(MUSCLE, 3 * np.ones(7), 2.0)
    assert kept.traced == 1
