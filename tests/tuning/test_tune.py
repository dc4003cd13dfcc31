"""A tuned controller: terms by hand, the optimum by another method, files, what it says; and a network."""

import dataclasses

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pandas as pd
import pytest
from actuators.fan import STEP, fan
from oracles.bench import built
from scipy.optimize import minimize

import jaxmuscle as jm
from jaxmuscle import control
from jaxmuscle.control import PID, closed_loop, feedback_on
from jaxmuscle.errors import InputError
from jaxmuscle.estimation.serialization import as_toml, plain

TIMES = STEP * np.arange(150)
UP = np.where(TIMES < 0.5, 150.0, 190.0)
WAVE = 160.0 + 25.0 * np.sin(3 * TIMES)
START = {"speed": 150.0}
SIZES = {"tracking": 1.0, "variation": 20.0}
CONTROLLER = built(PID, 0.05, 0.1)
PRACTICE = jm.tuning.grid([UP, WAVE], TIMES, {"inertia": [2e-4, 4e-4]}, start=START, noise={"speed": 0.2})
UNSEEN = jm.tuning.grid([150.0 + 20.0 * np.sin(5 * TIMES)], TIMES, {"inertia": [3e-4]}, start=START)


@pytest.fixture(scope="module")
def tuned():
    lines = []
    found = jm.tune(
        fan(),
        CONTROLLER,
        PRACTICE,
        SIZES,
        held_out=UNSEEN,
        progress=lines.append,
    )
    assert len(lines) > 2 and all("cost" in line for line in lines)
    return found


def by_hand(gains):
    """Cost of the practice scenarios: one closed loop after the other, terms in NumPy."""
    costs = []
    for scenario in PRACTICE:
        blown = jm.replace(fan(), scenario.changes)
        noise = 0.2 * np.random.default_rng([scenario.seed, 0]).standard_normal(len(TIMES))
        loop = feedback_on(blown, jm.replace(CONTROLLER, gains))
        # Noise that a controller of the error adds to a reading is noise taken off its reference.
        found = closed_loop(blown, loop, scenario.reference - noise, TIMES, start=START)
        error = scenario.reference - np.asarray(found.readings["speed"])
        rate = np.diff(np.asarray(found.commands)) / STEP
        costs.append(np.mean(error**2) + np.mean(rate**2) / 400)
    return np.array(costs)


def test_cost_is_that_of_closed_loops_by_hand(tuned):
    before = by_hand({"proportional": 0.05, "integral": 0.1})
    np.testing.assert_allclose(tuned.before.terms["cost"], before, rtol=1e-9)
    assert tuned.before.cost == pytest.approx(before.mean(), rel=1e-9)
    assert tuned.after.cost == pytest.approx(by_hand(tuned.values).mean(), rel=1e-9)


def test_another_method_finds_the_same_optimum(tuned):
    def cost(logarithms):
        return by_hand(dict(zip(tuned.values, np.exp(logarithms), strict=True))).mean()

    other = minimize(cost, np.log([0.3, 5.0]), method="Nelder-Mead", options={"fatol": 1e-6, "xatol": 1e-4})
    assert tuned.code == "converged" and tuned.after.cost < 0.5 * tuned.before.cost
    assert tuned.after.cost == pytest.approx(other.fun, rel=1e-3)


def test_the_last_word_is_that_of_the_scenario_held_out(tuned):
    assert tuned.holds and list(tuned.held_out_after.terms.index) == ["4"]
    loop = feedback_on(fan(), tuned.controller)
    blown = jm.replace(fan(), UNSEEN[0].changes)
    found = closed_loop(blown, loop, UNSEEN[0].reference, TIMES, start=START)
    trace = tuned.traces["held out: 4"]
    np.testing.assert_allclose(trace["speed after"], found.readings["speed"], rtol=1e-12)
    np.testing.assert_allclose(trace["command after"], found.commands, rtol=1e-9, atol=1e-12)
    np.testing.assert_array_equal(trace["reference"], UNSEEN[0].reference)


def test_sensitivities_are_rises_of_the_cost(tuned):
    for name, gain in tuned.gains.items():
        for factor, told in ((0.9, gain.less), (1.1, gain.more)):
            there = by_hand({**tuned.values, name: factor * gain.value}).mean()
            assert told == pytest.approx(there / tuned.after.cost - 1, abs=1e-9)
            assert told > -1e-4


def test_what_is_saved_is_read_back(tuned, tmp_path):
    file = tuned.save(tmp_path / "gains.toml", traces=True)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["gains.npz", "gains.toml"]
    back = jm.tuning.Tuning.load(file)
    assert str(back) == str(tuned) and back.values == tuned.values and back.controller is None
    assert back.settings == tuned.settings and back.settings["objective"] == SIZES
    assert back.settings["controller"] == "PID" and back.settings["reading"] == "speed"
    for name, table in tuned.traces.items():
        np.testing.assert_array_equal(back.traces[name].to_numpy(), table.to_numpy())
    again = back.put_into(feedback_on(fan(), CONTROLLER)).controller
    assert jax.tree.all(jax.tree.map(lambda a, b: bool(a == b), again, tuned.controller))
    assert len(back.plot().axes) == 6
    bare = back.put_into(built(PID, 0.0))
    assert (float(bare.proportional), float(bare.integral)) == tuple(tuned.values.values())
    with pytest.raises(InputError, match="gains: unknown gain 'proportional'"):
        back.put_into(built(control.ProportionalForce))
    other = tmp_path / "other.toml"
    other.write_text("kind = 'jaxmuscle fit'\n")
    with pytest.raises(InputError, match="not a tuning"):
        jm.tuning.Tuning.load(other)


def test_gains_are_saved_without_traces(tuned, tmp_path):
    file = tuned.save(tmp_path / "gains.toml")
    assert [path.name for path in tmp_path.iterdir()] == ["gains.toml"]
    assert file.stat().st_size < 8000
    back = jm.tuning.Tuning.load(file)
    assert back.traces == {} and str(back) == str(tuned) and back.gains == tuned.gains
    assert back.held_out_after is not None
    pd.testing.assert_frame_equal(back.held_out_after.terms, tuned.held_out_after.terms)
    assert len(back.plot().axes) == 2
    # A file whose traces have gone is still a tuning; one whose traces are something else is not.
    tuned.save(file, traces=True)
    file.with_suffix(".npz").write_text("no traces")
    with pytest.raises(InputError, match="gains.npz: cannot be read as the traces of a tuning"):
        jm.tuning.Tuning.load(file)
    np.savez(file.with_suffix(".npz"), other=np.zeros(2))
    with pytest.raises(InputError, match="gains.npz: cannot be read as the traces of a tuning"):
        jm.tuning.Tuning.load(file)
    file.with_suffix(".npz").unlink()
    assert jm.tuning.Tuning.load(file).traces == {}


def test_a_file_of_the_first_format_is_read(tuned, tmp_path):
    """It held its traces within, and no settings."""
    content = {"kind": "jaxmuscle tuning", "format": 1, "jaxmuscle": "0.1.0"}
    apart = ("controller", "settings")
    fields = {f.name: getattr(tuned, f.name) for f in dataclasses.fields(tuned) if f.name not in apart}
    file = tmp_path / "gains.toml"
    file.write_text(as_toml(content | {name: plain(value) for name, value in fields.items()}))
    back = jm.tuning.Tuning.load(file)
    assert str(back) == str(tuned) and back.settings == {}
    for name, table in tuned.traces.items():
        np.testing.assert_array_equal(back.traces[name].to_numpy(), table.to_numpy())
    file.write_text(file.read_text().replace("format = 1", "format = 3"))
    with pytest.raises(InputError, match="whose files differ; tune again"):
        jm.tuning.Tuning.load(file)


def test_the_text_names_gains_terms_and_units(tuned):
    said = str(tuned)
    for part in (
        "4 training scenarios",
        "1 held-out ones",
        "proportional",
        "V/(rad/s)",
        "overshoot",
        "at +10 %",
    ):
        assert part in said


class Network(eqx.Module):
    """Two layers of tanh from the error and its integral to the volts."""

    inner: eqx.nn.MLP

    def start(self):
        return jnp.zeros(())

    def update(self, state, wanted, measured, step):
        error = wanted - measured
        grown = state + step * error
        return grown, 6.0 + 6.0 * self.inner(jnp.stack([error / 40, grown / 40, wanted / 200]))


def network():
    return Network(eqx.nn.MLP(3, "scalar", 6, 1, activation=jnp.tanh, key=jax.random.key(0)))


@pytest.mark.slow
@pytest.mark.parametrize("squares", [True, False], ids=["forward", "reverse"])
def test_a_network_is_tuned_like_any_other_controller(squares):
    def mean_square(run, reference):
        return jnp.mean((run.readings["speed"] - reference) ** 2)

    objective = {"tracking": 1.0} if squares else mean_square
    found = jm.tune(fan(), network(), PRACTICE[:2], objective, held_out=UNSEEN, starts=1, steps=25)
    assert len(found.gains) == 31 and "inner.layers[0].weight[0,1]" in found.gains
    assert found.after.cost < 0.1 * found.before.cost and found.holds
    assert found.controller.inner.activation is jnp.tanh


class Wide(Network):
    """One whose output is a row."""

    def update(self, state, wanted, measured, step):
        state, output = super().update(state, wanted, measured, step)
        return state, output[None]


def test_a_network_whose_output_has_the_wrong_shape_is_told():
    with pytest.raises(
        InputError, match=r"Wide: expected an output of one number, shape \(\); got shape \(1,\)"
    ):
        jm.tune(fan(), Wide(network().inner), PRACTICE[:1], {"tracking": 1.0})


def test_worst_case_brings_the_scenarios_nearer_to_each_other(tuned):
    worst = jm.tune(fan(), CONTROLLER, PRACTICE, SIZES, worst=16)
    costs, mean = worst.after.terms["cost"], tuned.after.terms["cost"]
    assert costs.max() < mean.max() and costs.mean() > mean.mean()
    assert worst.holds is None and any("held out" in note for note in worst.notes)
    assert worst.after.cost == pytest.approx(float(np.mean(costs**16) ** (1 / 16)), rel=1e-9)


@pytest.mark.slow
def test_a_loop_that_runs_away_is_begun_at_smaller_gains():
    free = dataclasses.replace(feedback_on(fan(), CONTROLLER), lowest=-np.inf, highest=np.inf)
    wild = dataclasses.replace(free, controller=built(PID, 3e3, 1e3))
    sound, found = (jm.tune(fan(), loop, PRACTICE[:2], SIZES, held_out=UNSEEN) for loop in (free, wild))
    assert np.isinf(found.before.cost) and found.after.cost < 1.05 * sound.after.cost
    assert all(np.isfinite(value) for value in found.values.values())
    assert any("unstable at its start gains: in scenario 0 the speed" in note for note in found.notes)
    assert "not finite to" in str(found)


def test_a_start_that_runs_away_beside_others_is_given_up_and_told():
    free = dataclasses.replace(feedback_on(fan(), built(PID, 3e3, 1e3)), lowest=-np.inf, highest=np.inf)
    starts = [{"proportional": 3e3}, {"proportional": 0.05, "integral": 0.1}]
    found = jm.tune(fan(), free, PRACTICE[:2], SIZES, starts=starts)
    assert np.isfinite(found.after.cost) and np.isinf(found.before.cost)
    (note,) = (note for note in found.notes if "given up" in note)
    assert "unstable at its start gains: in scenario 0 the speed" in note and "At 1 of 2 starts" in note


def test_a_loop_that_runs_away_everywhere_is_told():
    wrong = dataclasses.replace(feedback_on(fan(), CONTROLLER), lowest=np.nan, highest=np.nan)
    with pytest.raises(
        InputError, match=r"unstable at its start gains \(proportional = 0.05, integral = 0.1.*in scenario 0"
    ):
        jm.tune(fan(), wrong, PRACTICE[:1], SIZES)


def test_out_of_time_the_best_so_far_is_returned():
    found = jm.tune(fan(), CONTROLLER, PRACTICE, SIZES, budget=0.0)
    assert found.code == "budget" and any("out of time" in note for note in found.notes)
    assert found.after.cost <= found.before.cost
