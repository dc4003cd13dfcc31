"""A rig and an effect of a user's own: fitted, saved, loaded; arrays of parameters; the solver's error."""

import dataclasses

import equinox as eqx
import numpy as np
import pytest
from estimation.own_rig import STEP, TRUE, Drive, drive, measured

import jaxmuscle as jm
from jaxmuscle import InputError
from jaxmuscle.actuators import RIGS, Isotonic, register
from jaxmuscle.estimation import multistart
from jaxmuscle.estimation.parameter_layout import layout
from jaxmuscle.estimation.request import Asked
from jaxmuscle.parameters import get

FREE = ["mass", "load_damping.coefficient", "spring.stiffness"]


def recorded(machine, **how):
    """The drive's recording."""
    return jm.recording(machine, measured(), STEP, noise={"position": 1e-4}, name="own", **how)


@pytest.fixture(scope="module")
def result():
    start = drive(5.0, (50.0, 5.0), 5.0)
    return jm.fit(start, recorded(start), FREE)


def test_a_fit_needs_no_registration(result):
    assert result.converged and Drive.rig not in RIGS
    true = {"mass": TRUE["mass"], "effects.load_damping.coefficient": TRUE["damping"]}
    true |= {f"effects.spring.stiffness[{i}]": TRUE["stiffness"][i] for i in (0, 1)}
    assert set(result.parameters) == set(true)
    for name, value in true.items():
        fitted = result.parameters[name]
        assert abs(fitted.value - value) < 4 * fitted.std, name
        assert fitted.std < 0.05 * value
    np.testing.assert_array_equal(
        get(result.actuator, "effects.spring.stiffness"),
        [result.values[f"effects.spring.stiffness[{i}]"] for i in (0, 1)],
    )


@pytest.mark.slow
def test_the_error_of_the_solver_is_taken_off(result, monkeypatch):
    """At steps of 10 ms, the rig's longest, a parameter is off by more than what it is known to."""

    class Fine(Drive):
        largest_step = 1e-3

    start = drive(5.0, (50.0, 5.0), 5.0)
    fine = Fine(mass=start.mass, gain=start.gain, effects=start.effects)
    exact = jm.fit(fine, recorded(fine), FREE).parameters
    monkeypatch.setattr(multistart, "refined", lambda objective, u, matrix: objective)
    plain = jm.fit(start, recorded(start), FREE)

    def off(found):
        return max(abs(found.values[name] - e.value) / e.std for name, e in exact.items())

    assert off(plain) > 0.5
    assert off(result) < 0.1


def test_entries_of_an_array_by_themselves():
    machine = drive()

    def laid_out(free, **asked):
        return layout(machine, [recorded(machine)], ["own"], Asked(free, **asked))

    one = laid_out(["spring.stiffness[1]", "mass"], bounds={"spring.stiffness": (0.0, 100.0)})
    assert one.names == ("effects.spring.stiffness[1]", "mass")
    assert (one.entries[0].start, one.entries[0].upper) == (TRUE["stiffness"][1], 100.0)
    assert laid_out(["spring.stiffness"]).names == tuple(f"effects.spring.stiffness[{i}]" for i in (0, 1))
    with pytest.raises(InputError, match="bounds: 'spring.stiffness' is not free"):
        laid_out(["mass"], bounds={"spring.stiffness": (0.0, 100.0)})
    with pytest.raises(InputError, match=r"unknown parameter 'spring.stiffness\[2\]'; did you mean"):
        laid_out(["spring.stiffness[2]"])
    with pytest.raises(InputError, match="not a number"):
        machine = drive(stiffness=(60.0, np.nan))
        laid_out(["spring.stiffness"])


def test_a_fit_of_an_own_rig_is_saved_when_it_is_registered(result, tmp_path):
    machine = drive().without_effects("spring")
    bare = dataclasses.replace(result, actuator=machine, actuators=(machine,), parameters={})
    with pytest.raises(InputError, match="only registered rigs"):
        bare.save(tmp_path / "fit.json")
    with pytest.raises(InputError, match="unknown rig 'tested-drive'.*register it"):
        bare.to_card()
    register(Drive)
    try:
        loaded = jm.FitResult.load(bare.save(tmp_path / "fit.json"))
        assert eqx.tree_equal(loaded.actuator, machine)
        assert float(get(jm.actuator(bare.to_card()), "mass")) == TRUE["mass"]
    finally:
        del RIGS[Drive.rig]
    with pytest.raises(InputError, match="rig 'tested-drive' is unknown; if it is your own"):
        jm.FitResult.load(tmp_path / "fit.json")


def test_rigs_that_cannot_be_registered():
    class Nameless(Drive):
        rig = "isotonic"

    with pytest.raises(InputError, match="the name 'isotonic' is that of Isotonic"):
        register(Nameless)
    assert register(Isotonic) is Isotonic
    with pytest.raises(InputError, match="expected class variables rig, units"):
        register(jm.actuators.AbstractActuator)


@pytest.mark.parametrize(
    ("how", "told"),
    [
        (
            {"columns": {"command": [0.0]}},
            "columns: position missing; rig 'tested-drive' has command, position",
        ),
        ({"columns": {"comand": [0.0]}}, "columns: unknown column 'comand'; did you mean 'command'"),
        (
            {"columns": {"command": [0.0], "position": [0.0, 1.0]}},
            "one axis of samples, of one length for all",
        ),
        ({"step": 0.0}, "step: expected the time between two samples"),
        ({"noise": {"force": 1.0}}, "noise: unknown column 'force'"),
        ({"noise": {"position": 0.0}}, r"noise\['position'\]: expected a standard deviation above zero"),
        ({"state_from": "later"}, r"state_from: expected .past., .* got 'later'"),
        ({"horizon": 100.0}, "horizon: expected a time from one step, 0.01 s, to the whole recording, 4 s"),
        ({"breaks": [400]}, "breaks: expected rows between 1 and 399"),
    ],
)
def test_arrays_that_are_no_recording(how, told):
    with pytest.raises(InputError, match=told):
        jm.recording(**{"actuator": drive(), "columns": measured(), "step": STEP, **how})


def test_a_column_without_a_unit():
    class Warm(Drive):
        outputs = {"position": ("warmth",)}  # noqa: RUF012

    machine = drive()
    warm = Warm(mass=machine.mass, gain=machine.gain, effects=machine.effects)
    with pytest.raises(InputError, match="column 'warmth': expected one of command, time, pressure"):
        jm.recording(warm, {}, STEP)


def test_what_scales_together_is_told_so_even_if_it_might_be_zero():
    """Mass, force per volt, damping and springs: motion tells only their ratios."""
    machine = drive()
    found = jm.fit(
        machine, recorded(machine), ["mass", "gain", "load_damping.coefficient", "spring.stiffness"]
    )
    (combination,) = found.undetermined
    assert list(combination.exponents.values()) == pytest.approx([1.0] * 5, rel=0.01)
    assert "the data allow to scale mass · gain · effects.load_damping.coefficient ·" in combination.words
