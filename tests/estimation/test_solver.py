"""Fits by solvers of optimistix: the same minimum within the same bounds, told in the same way."""

import numpy as np
import optimistix as optx
import pytest
from estimation.made import fitted, lifted, pulled

import jaxmuscle as jm
from jaxmuscle.errors import InputError
from jaxmuscle.estimation import residuals

SOLVERS = {
    "LevenbergMarquardt": optx.LevenbergMarquardt(1e-3, 1e-3),
    "Dogleg": optx.Dogleg(1e-3, 1e-3),
    "BFGS": optx.BFGS(1e-3, 1e-3),
}
FREE = ("valve_area", "end_factor", "effects.load_damping.coefficient")


@pytest.fixture(scope="module")
def recording():
    return lifted(3.0, off=1.2)


@pytest.fixture(scope="module")
def own(recording):
    return fitted(recording, *FREE)


@pytest.mark.slow
@pytest.mark.parametrize("name", SOLVERS)
def test_it_ends_at_our_minimum(name, recording, own):
    found = fitted(recording, *FREE, solver=SOLVERS[name])
    assert found.converged and found.cost == pytest.approx(own.cost, rel=1e-5)
    for parameter, value in found.parameters.items():
        # Both end within a twentieth of a standard deviation of the minimum.
        assert value.value == pytest.approx(own.parameters[parameter].value, abs=0.1 * value.std)
        assert value.std == pytest.approx(own.parameters[parameter].std, rel=0.02)


@pytest.mark.slow
def test_no_simulation_is_compiled_anew_for_it(recording, own, monkeypatch):
    """The programs of our own fit are taken; `_block` runs once for each link that is traced."""
    traced = []
    block = residuals._block
    monkeypatch.setattr(residuals, "_block", lambda *args: traced.append(1) or block(*args))
    again = fitted(recording, *FREE, solver=optx.GaussNewton(1e-3, 1e-3))
    assert again.cost == pytest.approx(own.cost, rel=1e-5) and not traced


def test_a_bound_is_a_bound(recording, own):
    limit = 0.999 * own.values["end_factor"]
    how = {"bounds": {"end_factor": (0.9, limit)}}
    ours, theirs = (
        fitted(recording, *FREE, solver=solver, **how) for solver in (None, SOLVERS["LevenbergMarquardt"])
    )
    assert theirs.parameters["end_factor"].at_bound == "upper" and theirs.values["end_factor"] == limit
    assert theirs.cost == pytest.approx(ours.cost, rel=1e-5)


@pytest.mark.slow
def test_many_starts_budget_progress_and_losses(recording, own):
    said = []
    found = fitted(
        recording, *FREE, starts=3, loss="huber", solver=SOLVERS["LevenbergMarquardt"], progress=said.append
    )
    assert [start.code for start in found.starts] == ["converged"] * 3
    assert all(start.reached for start in found.starts)
    assert any("3 under way" in text for text in said)
    plain = fitted(recording, *FREE, loss="huber")
    assert found.cost == pytest.approx(plain.cost, rel=1e-5)
    late = fitted(recording, *FREE, solver=SOLVERS["LevenbergMarquardt"], budget=1e-3)
    assert late.code == "budget" and np.isfinite(late.cost)


def test_a_refit_is_our_own(recording):
    found = fitted(recording, *FREE, solver=SOLVERS["LevenbergMarquardt"])
    assert "solver" not in found.settings
    assert found.refit(recording).cost == pytest.approx(found.cost, rel=1e-6)


def test_what_is_no_solver_is_told_before_anything_is_computed():
    recording = pulled(seconds=1.0)
    machine = jm.actuator(recording.card)
    with pytest.raises(InputError, match="solver: expected a solver of optimistix, such as"):
        jm.fit(machine, recording, solver="lm")
    with pytest.raises(InputError, match="solver: NelderMead does not step by derivatives"):
        jm.fit(machine, recording, solver=optx.NelderMead(1e-3, 1e-3))
