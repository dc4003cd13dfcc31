"""Padding to sizes of a series changes no number, and lets recordings of several lengths share a program."""

import dataclasses

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from oracles import bench
from oracles.recorded import driven_card, driven_recording

import jaxmuscle as jm
from jaxmuscle.estimation.case import case
from jaxmuscle.estimation.padding import in_buckets, vector_without_padding, without_padding
from jaxmuscle.estimation.residuals import evaluate, residuals, values_and_slopes
from jaxmuscle.estimation.windows import FACTOR, bucket
from jaxmuscle.parameters import replace

SAMPLES = 700


def first_rows(recording, rows, breaks=()):
    """The beginning of a recording."""
    columns = {name: values[:rows] for name, values in recording.columns.items()}
    return dataclasses.replace(recording, time=recording.time[:rows], columns=columns, breaks=tuple(breaks))


@pytest.fixture(scope="module")
def lift():
    return jm.read(jm.sample("lift"))


@pytest.fixture(scope="module")
def driven():
    ends = {"pressure_dependent_ends": bench.ENDS}
    return driven_recording(ends, driven_card({}), seconds=6.0)


def test_sizes_grow_by_the_factor():
    sizes = [bucket(size) for size in range(1, 3000)]
    assert sizes == sorted(sizes)
    for size, found in enumerate(sizes, start=1):
        assert size <= found <= max(size, FACTOR * (size - 1) + 1)
        assert bucket(found) == found
    assert len(set(sizes)) < 35


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["lift", "lift with a break", "driven"])
def test_residuals_and_their_slopes_are_the_same(kind, lift, driven):
    if kind == "driven":
        prepared, path = case(driven, 0.2), "muscle.end_factor"
    else:
        breaks = (330,) if "break" in kind else ()
        prepared, path = case(first_rows(lift, SAMPLES, breaks), 0.2), "valve.area"
    problem = prepared.training.in_parts(4)
    common = in_buckets(problem)
    assert common.total > problem.total or len(common.rows) > len(problem.rows)

    @eqx.filter_jit
    def slopes(problem):
        value = jm.parameters.get(prepared.actuator, path)
        push = lambda factor: residuals(replace(prepared.actuator, {path: factor * value}), problem)  # noqa: E731
        return jax.jvp(push, (jnp.asarray(1.1),), (jnp.asarray(1.0),))

    plain, own = slopes(problem)
    found = slopes(common)
    assert max(np.abs(values).max() for values in own.values()) > 0
    for output in plain:
        weights = np.asarray(without_padding(common.weights, problem)[output])
        np.testing.assert_array_equal(weights, problem.weights[output])
        assert float(common.weights[output].sum()) == pytest.approx(float(weights.sum()), rel=1e-13)
        scale = np.abs(plain[output]).max()
        cut = without_padding(found[0], problem)[output]
        np.testing.assert_allclose(cut, plain[output], rtol=0, atol=1e-11 * scale)
        assert float((found[0][output] ** 2).sum()) == pytest.approx(float((plain[output] ** 2).sum()))
        scale = np.abs(own[output]).max()
        assert np.isfinite(found[1][output]).all()
        cut = without_padding(found[1], problem)[output]
        np.testing.assert_allclose(cut, own[output], rtol=0, atol=1e-11 * scale)


def test_vectors_with_axes_before_the_residuals(driven):
    prepared = case(driven, 0.2)
    problem, common = prepared.problem, in_buckets(prepared.problem)
    outputs = list(problem.targets)
    flat = np.concatenate([np.ravel(common.targets[output]) for output in outputs])
    found = vector_without_padding(np.stack([flat, 2 * flat]), outputs, problem, common)
    own = np.concatenate([np.ravel(problem.targets[output]) for output in outputs])
    np.testing.assert_array_equal(found, np.stack([own, 2 * own]))


def test_windows_keep_the_length_that_a_horizon_fixes(lift):
    fixed = case(first_rows(lift, SAMPLES), 0.2).problem
    assert fixed.fixed and in_buckets(fixed).samples == fixed.samples
    card = dataclasses.replace(lift.card, horizon=None)
    whole = case(dataclasses.replace(first_rows(lift, SAMPLES), card=card), 0.2).problem
    assert not whole.fixed and in_buckets(whole).samples == bucket(whole.samples) > whole.samples


@pytest.mark.parametrize("breaks", [(), (100, 330)])
def test_all_sizes_follow_from_the_rows(lift, breaks):
    """However long two recordings of one size are, training windows and all windows fit into the same."""
    sizes = set()
    for rows in range(bucket(600), bucket(600) - 60, -7):
        prepared = case(first_rows(lift, rows, breaks), 0.3)
        for part in (prepared.training, prepared.problem):
            common = in_buckets(part)
            assert len(common.rows) >= len(part.rows) and common.total >= part.total
        sizes.add((len(common.rows), common.total, common.samples, len(common.track.command)))
    assert len(sizes) == 1


@pytest.mark.slow
def test_lengths_of_one_size_share_a_program(lift):
    traced = []

    @eqx.filter_jit
    def evaluated(model, problem):
        traced.append(problem.total)
        return residuals(model, problem)

    rows = bucket(SAMPLES)
    cases = [case(first_rows(lift, length), 0.0) for length in (rows, rows - 40)]
    assert cases[0].problem.total != cases[1].problem.total
    for prepared in cases:
        evaluated(prepared.actuator, in_buckets(prepared.problem))
    assert len(traced) == 1
    for prepared in cases:
        plain = eqx.filter_jit(residuals)(prepared.actuator, prepared.problem)
        for output, values in evaluate(prepared.actuator, prepared.problem).items():
            assert values.shape == plain[output].shape
            size = np.abs(plain[output]).max()
            np.testing.assert_allclose(values, plain[output], rtol=0, atol=1e-11 * size)


@pytest.mark.slow
def test_fits_of_two_lengths_share_their_programs(lift):
    """And each is what it would be alone: the readings that count are its own."""

    def programs():
        return values_and_slopes.plain._cached._cache_size()  # pyright: ignore[reportFunctionMemberAccess]

    rows = bucket(SAMPLES)
    machine = jm.actuator(lift.card)
    first = jm.fit(machine, first_rows(lift, rows), ["valve.area"])
    before = programs()
    second = jm.fit(machine, first_rows(lift, rows - 40), ["valve.area"])
    assert programs() == before > 0
    assert first.samples == 2 * rows and second.samples == 2 * (rows - 40)
    near = first.parameters["valve_area"].std
    assert abs(second.values["valve_area"] - first.values["valve_area"]) < 5 * near
