"""Compiled programs take areas of memory, of which there may be so many: they are forgotten in time."""

import sys

import jax
import jax.numpy as jnp
import pytest

import jaxmuscle as jm
from jaxmuscle import _memory_areas
from jaxmuscle._memory_areas import AREAS, MOST, make_room_for_programs
from jaxmuscle.diagnosis import diagnose
from jaxmuscle.estimation import fit
from jaxmuscle.tuning import optimal_reference, tune

linux = pytest.mark.skipif(sys.platform != "linux", reason="only Linux counts areas of memory")


def areas() -> int:
    return len(AREAS.read_text().splitlines())


@pytest.fixture
def few_left(monkeypatch, tmp_path):
    """A system that allows less than twice as many as there are."""
    most = tmp_path / "most"
    most.write_text(f"{2 * areas() - 2}\n")
    monkeypatch.setattr(_memory_areas, "MOST", most)


@pytest.mark.slow
@linux
def test_programs_are_forgotten_where_few_areas_are_left(few_left):
    before = areas()
    functions = [jax.jit(lambda x, n=n: jnp.sin(x) ** n) for n in range(40)]
    values = [float(function(0.5)) for function in functions]
    held = areas()
    assert held > before + 20
    assert make_room_for_programs()
    assert areas() < held - 20
    assert [float(function(0.5)) for function in functions] == values


@linux
def test_they_stay_where_there_are_many_left():
    assert areas() < 0.5 * int(MOST.read_text())
    assert not make_room_for_programs()


@pytest.mark.parametrize("file", ["AREAS", "MOST"])
def test_a_system_that_does_not_tell_is_left_alone(monkeypatch, tmp_path, file):
    monkeypatch.setattr(_memory_areas, file, tmp_path / "nothing")
    assert not make_room_for_programs()


def lift():
    return jm.read(jm.sample("lift"))


GIVEN = {
    diagnose: lambda: [lift()],
    fit: lambda: [jm.actuator(lift().card), lift()],
    tune: lambda: [jm.actuator(lift().card), None, [], {}],
    optimal_reference: lambda: [jm.actuator(lift().card), None, [], {}],
}


@pytest.mark.parametrize("function", GIVEN)
def test_long_computations_ask_for_room_first(monkeypatch, function):
    class Asked(Exception):
        """Instead of all that follows."""

    def ask():
        raise Asked

    monkeypatch.setattr(sys.modules[function.__module__], "make_room_for_programs", ask)
    with pytest.raises(Asked):
        function(*GIVEN[function]())
