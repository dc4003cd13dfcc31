"""What a user may ask for and how it is refused: every message says what came and what to do."""

import dataclasses
from typing import Any

import numpy as np
import pytest
from estimation.made import fitted, lifted, pulled

import jaxmuscle as jm
from jaxmuscle import InputError
from jaxmuscle.estimation.fittable_parameters import fittable
from jaxmuscle.estimation.free_parameters import Prior
from jaxmuscle.estimation.missing_data import LONGEST_BRIDGE, usable
from jaxmuscle.estimation.parameter_layout import agreed_prior, conditions, labels, layout
from jaxmuscle.estimation.request import Asked
from jaxmuscle.estimation.starting_points import given_starts
from jaxmuscle.parameter_names import column_of_offset, resolve
from jaxmuscle.parameters import get


@pytest.fixture(scope="module")
def recording():
    return pulled()


@pytest.fixture(scope="module")
def actuator(recording):
    return jm.actuator(recording.card)


def laid_out(recording, **asked):
    """The unknowns of one recording."""
    return layout(jm.actuator(recording.card), [recording], ["pull"], Asked(**asked))


@pytest.mark.parametrize(
    ("how", "told"),
    [
        ({"free": ["endfactor"]}, "free: unknown parameter 'endfactor'; did you mean 'end_factor'"),
        ({"free": ["offset.posit"]}, "did you mean 'offset.position'"),
        ({"per_recording": ["zzz"]}, "per_recording: unknown parameter 'zzz'; expected one of"),
        ({"free": "end_factor"}, "free: expected a list of names; got the text 'end_factor'"),
        ({"free": []}, "nothing is free"),
        ({"profiles": ["mas"]}, "profiles: unknown parameter 'mas'"),
        ({"shared": ["end_factor"], "per_recording": ["end_factor"]}, "both in shared and in per_recording"),
        (
            {"bounds": {"end_factor": (1.4, 2.0)}},
            r"its start, 1.303, is not within 1.4 to 2; widen the bounds",
        ),
        ({"bounds": {"end_factor": (2.0, 1.0)}}, "expected a lower one below the upper one; got 2 to 1"),
        (
            {"bounds": {"end_factor": 1.0}},
            r"bounds\['end_factor'\]: expected \(lower, upper\), None for none",
        ),
        ({"bounds": {"braid_angle": (0, 1)}}, "bounds: 'braid_angle' is not free; add it to free="),
        (
            {"priors": {"end_factor": (1.3, 0.0)}},
            r"prior of end_factor: expected \(mean, std\) with a std above zero",
        ),
        ({"priors": {"end_factor": (1.3, None)}}, r"priors\['end_factor'\]: expected \(mean, std\), or None"),
        (
            {"priors": {"end_factor": (1.3, 0.1), "muscle.end_factor": (1.4, 0.1)}},
            "priors: 'end_factor' is given twice",
        ),
        (
            {"priors": {"end_factor": (1.6, 0.1)}, "bounds": {"end_factor": (1.0, 1.5)}},
            "its mean, 1.6, contradicts the bounds 1 to 1.5",
        ),
        ({"priors": {"end_factor": (-1.0, 0.1)}}, "its mean, -1, contradicts the bounds 0 to inf"),
        ({"loss": "hubert"}, "loss: unknown 'hubert'; did you mean 'huber'"),
        (
            {"noise": "guess"},
            "noise: expected 'estimated', 'discrepancy' or a mapping of columns to values; got 'guess'",
        ),
        ({"noise": {"torque": 1.0}}, "noise: unknown column 'torque'; expected one of"),
        ({"noise": {"force": -1.0}}, r"noise\['force'\]: expected a standard deviation above zero"),
        ({"starts": 0}, "starts: expected a whole number from 1 on; got 0"),
        ({"starts": 2.5}, "starts: expected a whole number from 1 on; got 2.5"),
        ({"starts": {"end_factor": 1.2}}, "starts: expected a list with a mapping for each start"),
        ({"starts": [1.2]}, r"starts\[0\]: expected a mapping of names to values; got 1.2"),
        ({"starts": [{"end_factor": "1.2"}]}, r"starts\[0\]: expected a number \(SI\) for 'end_factor'"),
        ({"starts": [{"end_factor": -1.2}]}, r"starts\[0\]: end_factor = -1.2 is not within its bounds"),
        ({"free": ["end_factor", 3]}, "free: expected a list of names; got 3 among them"),
        ({"shared": "end_factor"}, "shared: expected a list of names; got the text 'end_factor'"),
        ({"profiles": "end_factor"}, "profiles: expected a list of names; got the text"),
        ({"profiles": ["braid_angle"]}, "profiles: 'braid_angle' is not free; add it to free="),
        ({"continuation": 30}, "continuation: expected a list of numbers; got 30"),
        ({"continuation": (6, 30)}, r"expected factors that fall from wide to narrow.*got \(6, 30\)"),
        ({"priors": [("end_factor", 1.3, 0.1)]}, "priors: expected a mapping of names"),
        ({"bounds": [(1, 2)]}, "bounds: expected a mapping of names"),
        (
            {"noise": 0.8},
            "noise: expected 'estimated', 'discrepancy' or a mapping of columns to values; got 0.8",
        ),
        ({"noise": {"force": "1 N"}}, r"noise\['force'\]: expected a standard deviation above zero"),
        ({"budget": -1.0}, "budget: expected a number of seconds, or None for no limit; got -1.0"),
        ({"budget": np.nan}, "budget: expected a number of seconds"),
        ({"budget": "3 s"}, "budget: expected a number of seconds, or None for no limit; got '3 s'"),
        ({"steps": 0}, "steps: expected a whole number from 1 on; got 0"),
        ({"seed": -1}, "seed: expected a whole number from 0 on; got -1"),
        ({"starts": []}, "starts: expected a number of starts or at least one mapping"),
        ({"starts": [{"mass": 1.0}]}, r"starts\[0\]: 'mass' is not free"),
        (
            {"starts": [{"end_factor": 3.0}], "bounds": {"end_factor": (1.0, 2.0)}},
            r"starts\[0\]: end_factor = 3 is not within its bounds, 1 to 2",
        ),
        (
            {"masks": [None, None]},
            "masks: expected a list with one mask .* for each of 1 recordings; got 2 of them",
        ),
        ({"masks": np.zeros(3, bool)}, "masks: expected one boolean for each of the 800 rows"),
        ({"masks": {"torque": np.zeros(800, bool)}}, "masks: recording 'pull' has no sensor 'torque'"),
        ({"masks": np.ones(800, bool)}, "recording 'pull': column 'pressure' has no usable reading"),
        ({"masks": np.arange(800) > 30}, "only 31 usable samples of force are left of 800"),
    ],
)
def test_refused(recording, how, told):
    with pytest.raises(InputError, match=told):
        fitted(recording, **how) if "free" not in how else jm.fit(
            jm.actuator(recording.card), recording, **how
        )


def test_no_recording(actuator):
    with pytest.raises(InputError, match="expected at least one recording to fit; got none"):
        jm.fit(actuator, [])


def test_recording_of_another_rig(actuator):
    with pytest.raises(InputError, match="is of a rig 'isotonic', the actuator of a rig 'driven'"):
        jm.fit(actuator, lifted(8.0, samples=300))


def test_no_machine_or_no_recording_at_all(recording, actuator):
    wrong: list[Any] = ["lift.csv", ["lift.csv"], recording.columns]
    for given in wrong:
        with pytest.raises(InputError, match=r"recordings(\[0\])?: expected recordings as jaxmuscle.read"):
            jm.fit(actuator, given)
    with pytest.raises(InputError, match="actuator: expected a machine, such as .* gives; got a Card"):
        jm.fit(recording.card, recording)
    with pytest.raises(InputError, match="recording 'pull' has no rows; leave it out"):
        jm.fit(actuator, recording.part(0, 0))


def test_a_column_without_a_reading(recording):
    nothing = {**recording.columns, "force": np.full(len(recording), np.nan)}
    with pytest.raises(InputError, match="column 'force' has no usable reading; a fit needs all"):
        fitted(dataclasses.replace(recording, columns=nothing))


def test_an_offset_begins_within_its_bounds_or_at_its_prior(recording):
    asked = {"free": ["end_factor", "offset.force"]}
    bounded = laid_out(recording, **asked, bounds={"offset.force": (1.0, 5.0)})
    known = laid_out(recording, **asked, priors={"offset.force": (2.0, 0.5)})
    assert (bounded.start[1], known.start[1], laid_out(recording, **asked).start[1]) == (1.0, 2.0, 0.0)


def test_priors_and_bounds_of_a_single_recording():
    one, other = pulled(name="one"), pulled(name="other")
    asked = Asked(
        per_recording=["offset.force"],
        priors={"offset.force": (0.0, 1.0), "offset.force[other]": (3.0, 0.5)},
        bounds={"offset.force[one]": (-2.0, None)},
    )
    found = layout(jm.actuator(one.card), [one, other], ["one", "other"], asked)
    entries = {entry.name: entry for entry in found.entries}
    assert entries["offset.force[one]"].prior == Prior(0.0, 1.0)
    assert entries["offset.force[other]"].prior == Prior(3.0, 0.5)
    assert (entries["offset.force[one]"].lower, entries["offset.force[other]"].lower) == (-2.0, -np.inf)
    shared = Asked(["offset.force"], bounds={"offset.force[one]": (-2.0, None)})
    with pytest.raises(InputError, match=r"unknown parameter 'offset.force\[one\]'"):
        layout(jm.actuator(one.card), [one, other], ["one", "other"], shared)


def test_starts_by_any_name_of_a_parameter():
    """Its path, or without the recording for all of them."""
    one, other = pulled(name="one", threads=True), pulled(name="other", threads=True)
    asked = Asked(per_recording=["offset.force"])
    unknowns = layout(jm.actuator(one.card), [one, other], ["one", "other"], asked)
    given = {"offset.force": 2.0, "muscle.end_factor": 1.2, "thread_friction.static_coefficient": 0.02}
    found = dict(zip(unknowns.names, unknowns.values(given_starts(unknowns, [given]))[0], strict=True))
    assert found["offset.force[one]"] == found["offset.force[other]"] == pytest.approx(2.0)
    assert found["end_factor"] == pytest.approx(1.2)
    assert found["effects.thread_friction.static_coefficient"] == pytest.approx(0.02)
    with pytest.raises(InputError, match="'offset.forc' is not free; did you mean 'offset.force'"):
        given_starts(unknowns, [{"offset.forc": 1.0}])


def test_a_missing_command():
    lift = lifted(8.0, samples=300)
    lift.columns["command"][7] = np.nan
    with pytest.raises(InputError, match="the command 'command' is not a number in row 7"):
        fitted(lift)


def test_contradictory_priors_of_two_cards():
    one, other = pulled(name="one"), pulled(off=1.3, name="other")
    with pytest.raises(
        InputError, match=r"contradictory priors of 'initial_radius'.*per_recording=\['initial_radius'\]"
    ):
        fitted([one, other])
    unknowns = layout(
        jm.actuator(one.card),
        [one, other],
        ["one", "other"],
        Asked(per_recording=["initial_radius", "end_factor"]),
    )
    starts = dict(zip(unknowns.names, unknowns.start, strict=True))
    assert starts["initial_radius[other]"] == pytest.approx(1.3 * starts["initial_radius[one]"])


def test_priors_that_agree_are_one():
    found = agreed_prior("mass", [("a", Prior(8.0, 0.1)), ("b", 8.0), ("c", Prior(8.2, 0.2))])
    assert found is not None and (found.mean, found.std) == (pytest.approx(8.04), 0.1)
    assert agreed_prior("mass", [("a", 8.0), ("b", None)]) is None


def test_what_the_cards_differ_in_is_each_recordings_own(recording):
    long = dataclasses.replace(recording, card=recording.card.updated({"initial_length": (0.35, None)}))
    machines = conditions(jm.actuator(recording.card), [recording, long], set())
    assert [float(get(m, "muscle.initial_length")) for m in machines] == [0.3, 0.35]
    kept = conditions(jm.actuator(recording.card), [recording, long], {"muscle.initial_length"})
    assert [float(get(m, "muscle.initial_length")) for m in kept] == [0.3, 0.3]
    # A single recording leaves the machine as the user made it.
    other = jm.replace(jm.actuator(recording.card), {"muscle.initial_length": 0.4})
    assert float(get(conditions(other, [recording], set())[0], "muscle.initial_length")) == 0.4


def test_names_of_recordings():
    named = lambda *names: labels([pulled(name=name) for name in names])  # noqa: E731
    assert named("a", "b", "a", "a") == ["a", "b", "a-2", "a-3"]
    assert named("a-3", "a", "a") == ["a-3", "a", "a-2"]
    assert named("a-2", "a", "a") == ["a-2", "a", "a-3"]
    assert named("a", "a", "a-2", "a-2") == ["a", "a-3", "a-2", "a-2-2"]


def test_names_of_parameters(actuator):
    bent = actuator.with_effects(creep=jm.effects.Creep())
    known = fittable(bent, {"force": 200.0})
    same = ("end_factor", "muscle.end_factor"), ("effects.creep.stiffness", "creep.stiffness")
    for one, other in same:
        assert resolve(known, one, "free") == resolve(known, other, "free")
    assert resolve(known, "offset.force", "free").typical == 2.0
    assert column_of_offset(resolve(known, "offset.force", "free").path) == "force"


def test_free_by_default_is_what_is_uncertain(recording):
    unknowns = laid_out(recording)
    assert unknowns.names == ("initial_radius", "end_factor")
    more = laid_out(pulled(threads=True), shared=["offset.force"])
    assert len(more) == 6 and more.names[-1] == "offset.force"
    assert [e.prior is None for e in more.entries] == [False] * 5 + [True]


def test_a_prior_can_be_dropped(recording):
    assert laid_out(recording, priors={"end_factor": None}).entries[1].prior is None


def test_short_gaps_are_bridged_and_long_ones_cut(actuator, recording):
    position = recording.columns["position"].copy()
    position[100:105] = np.nan
    position[300 : 301 + LONGEST_BRIDGE] = np.nan
    gappy = dataclasses.replace(recording, columns={**recording.columns, "position": position})
    found = usable(actuator, gappy, None)
    np.testing.assert_array_equal(np.flatnonzero(found.cut), np.arange(300, 301 + LONGEST_BRIDGE))
    missing = np.isnan(position)
    # The force is predicted from the position, so that nothing is known of it there.
    np.testing.assert_array_equal(found.ignored["force"][:, 0], missing)
    true = recording.columns["position"][100:105]
    np.testing.assert_allclose(found.recording.columns["position"][100:105], true, rtol=0, atol=2e-5)


def test_missing_output_needs_no_cut(actuator, recording):
    force = recording.columns["force"].copy()
    force[100:400] = np.nan
    found = usable(
        actuator, dataclasses.replace(recording, columns={**recording.columns, "force": force}), None
    )
    assert not found.cut.any()
    assert found.ignored["force"].sum() == 300
