"""A diagnosis in passes: among the usual effects, beside friction that builds up, among all."""

import dataclasses
import importlib
from types import MappingProxyType, SimpleNamespace
from typing import Any

import pytest

import jaxmuscle as jm
from jaxmuscle.diagnosis.passes import (
    LESS,
    _hides_something,
    _leaves_something,
    _predicts_inputs,
    in_passes,
)
from jaxmuscle.diagnosis.verdict import EXPLAINED, FAR_OFF, IMITATED, MISSING, MUCH
from jaxmuscle.effects import (
    CATALOGUE,
    EXTENSION,
    EccentricSprocket,
    Presliding,
    ThreadFriction,
)
from jaxmuscle.estimation.predicted_inputs import TRUSTED

module = importlib.import_module("jaxmuscle.diagnosis.diagnose")
going_on = importlib.import_module("jaxmuscle.diagnosis.passes")


SMOOTH: Any = type("Smooth", (), {"effects": MappingProxyType({})})()


class Added(str):
    """An effect that was added, told from others by its name alone."""

    @property
    def name(self):
        return str(self)

    @property
    def is_constant(self):
        return self.startswith("constant:")


@dataclasses.dataclass(frozen=True)
class Outcome:
    """What of a diagnosis decides."""

    missing_in_noise: float
    names: tuple[str, ...] = ()
    share_left: float = 0.4
    typical_error: float = 1.0
    seconds: float = 0.0
    declared: Any = SMOOTH
    violated_priors: Any = ()
    verdict: str = "effects found"
    rounds: Any = ()

    @property
    def added(self):
        return tuple(Added(name) for name in self.names)


def passes(*outcomes, constants=False, predicted=None, on_whole_windows=None, after_bristles=None):
    """The outcome, and with what each pass was asked to choose from.

    `predicted`, `on_whole_windows`, `after_bristles`: outcome of the usual effects with inputs of links as
    predicted, of all on whole windows, and of all there beside bristles; nothing found if `None`.
    """
    asked, left, first_asked = [], list(outcomes), []

    def seek(catalogue, first=None, constants=False, predicting=False, if_found=False, whole=False):
        assert if_found == bool(first_asked)
        if whole:
            assert catalogue in (asked[-1], asked[-1][1])
            return on_whole_windows if first is None else after_bristles
        first_asked.append(catalogue)
        if predicting and first is None and not constants and catalogue == first_asked[0]:
            return predicted
        goes_on = bool(asked) and _leaves_something(outcomes[0])
        assert predicting == (goes_on and not _hides_something(outcomes[0]))
        chosen = catalogue if first is None else (first, catalogue)
        asked.append(("constants", chosen) if constants else chosen)
        outcome = left.pop(0)
        return outcome if outcome.names or not if_found else None

    rarer: Any = (*EXTENSION, "sensor_offset")
    return in_passes(seek, CATALOGUE, rarer, constants), asked


@pytest.fixture(autouse=True)
def _without_a_machine(monkeypatch):
    monkeypatch.setattr(module, "reading_effects", lambda rig: ("sensor_offset",))
    monkeypatch.setattr(going_on, "_predicts_inputs", lambda diagnosis: True)


def test_the_usual_effects_are_enough_where_they_leave_nothing():
    found, asked = passes(Outcome(MISSING, ("creep",)))
    assert found.added == ("creep",) and asked == [CATALOGUE]


def test_usual_effects_are_tried_with_inputs_as_predicted():
    again = Outcome(0.9, ("creep",))
    found, asked = passes(Outcome(9.0), predicted=again)
    assert found.added == ("creep",) and asked == [CATALOGUE]
    found, asked = passes(Outcome(9.0, ("load_friction",)), Outcome(8.0), predicted=Outcome(8.9, ("creep",)))
    assert found.added == ("load_friction",) and len(asked) == 2


def test_an_eccentric_sprocket_is_a_rival_but_not_sought(monkeypatch):
    """Sought among all, it would be named where a joint lacks what the catalogue does not have."""
    asked = []

    def diagnosed(ready, catalogue, first=None, *, rivals=(), **rest):
        asked.append((catalogue, rivals))
        return Outcome(0.1, declared=ready.case.actuator)

    monkeypatch.undo()
    monkeypatch.setattr(module, "_diagnosed", diagnosed)
    monkeypatch.setattr(going_on, "_leaves_something", lambda found: False)
    jm.diagnose(jm.read(jm.sample("lift")))
    ((catalogue, rivals),) = asked
    assert EccentricSprocket in rivals and EccentricSprocket not in catalogue
    assert {*EXTENSION} < {*rivals}
    monkeypatch.setattr(going_on, "_leaves_something", lambda found: True)
    monkeypatch.setattr(going_on, "_predicts_inputs", lambda found: False)
    monkeypatch.setattr(going_on, "_has_dry_friction", lambda actuator: False)
    asked.clear()
    jm.diagnose(jm.read(jm.sample("lift")))
    assert len(asked) == 4 and not any(EccentricSprocket in catalogue for catalogue, _ in asked)


@pytest.mark.parametrize(("off", "asks"), [(1.4, True), (TRUSTED + 0.1, False), (None, False)])
def test_inputs_are_predicted_where_the_model_knows_them(monkeypatch, off, asks):
    monkeypatch.undo()
    column, inputs = SimpleNamespace(in_noise=off), {} if off is None else {"p": "pressure"}
    machine: Any = SimpleNamespace(outputs={"pressure": ("pressure_1",)})
    monkeypatch.setattr(going_on, "predictable_inputs", lambda model: inputs)
    found: Any = SimpleNamespace(model=machine, after={"training": {"pressure_1": column}})
    assert _predicts_inputs(found) == asks


def test_a_little_of_much_is_no_reason_to_go_on():
    for little in (Outcome(2.6, share_left=0.14), Outcome(4.6, share_left=0.01)):
        found, asked = passes(dataclasses.replace(little, names=("thread_friction",)))
        assert found.added == ("thread_friction",) and asked == [CATALOGUE]


def test_much_that_is_left_is_one_even_if_more_was_explained():
    """A drift of the force beside a bladder."""
    found, asked = passes(Outcome(6.6, ("bladder",), share_left=0.04), Outcome(0.3, ("bladder", "drift")))
    assert found.added == ("bladder", "drift") and len(asked) == 2


def test_nothing_is_unexplained_before_all_effects_were_tried():
    """Also where little is missing over the windows' first states: all of the recording may hold more."""
    little = Outcome(MISSING, verdict="unexplained"), Outcome(0.2, ("supply_droop",))
    found, asked = passes(*little)
    assert found.added == ("supply_droop",) and len(asked) == 2
    _, asked = passes(Outcome(MISSING, verdict="undecided"))
    assert asked == [CATALOGUE]


def test_all_are_tried_where_predictions_are_far_off():
    """First states of windows may be the cause; a drooping supply (blind lift 110281) hid behind them."""
    first = Outcome(0.3, typical_error=FAR_OFF + 0.4)
    droop = Outcome(0.3, ("supply_droop",), typical_error=1.2)
    found, asked = passes(first, droop)
    assert found.added == ("supply_droop",) and len(asked) == 2
    for no_closer in (
        {"typical_error": LESS * first.typical_error + 0.1},
        {"missing_in_noise": MISSING + 0.1},
    ):
        found, _ = passes(first, dataclasses.replace(droop, **no_closer))
        assert not found.added
    _, asked = passes(Outcome(0.3, typical_error=FAR_OFF))
    assert asked == [CATALOGUE]


def test_what_leaves_most_of_the_errors_of_predictions_does_not_count():
    """Given the other readings a stop at the end of a clean lift's way left nothing, as others did."""
    stop = Outcome(0.9, ("end_stop",), share_left=IMITATED + 0.3)
    found, _ = passes(Outcome(2.5), stop)
    assert not found.added
    found, _ = passes(Outcome(2.5), dataclasses.replace(stop, share_left=IMITATED))
    assert found.added == ("end_stop",)


@pytest.mark.parametrize(
    ("others", "counts"),
    [((), False), ((True, True), True), ((True, False), False), ((None,), False), ((True, None), True)],
)
def test_what_leaves_most_counts_all_the_same_if_it_is_told_apart_from_all_others(others, counts):
    """`others`: whether each was told apart; `None` of one that was not judged."""
    entry = lambda told: SimpleNamespace(judged=told is not None, told_apart=told is not False)  # noqa: E731
    ranking = [entry(False), *map(entry, others)]
    rounds = [SimpleNamespace(added=None, ranking=[entry(False), entry(False)])]
    rounds += [SimpleNamespace(added="dead_band", ranking=ranking)]
    band = Outcome(1.9, ("dead_band",), share_left=IMITATED + 0.2, rounds=rounds)
    found, _ = passes(Outcome(3.3), band)
    assert found.added == (("dead_band",) if counts else ())


def test_all_are_tried_where_a_wrong_constant_leaves_a_part():
    """It may imitate an effect: a supply that droops under flow looks like one of a lower pressure."""
    usual = Outcome(9.0)
    part = Outcome(2.9, ("constant:supply",), share_left=0.5)
    found, asked = passes(usual, part, Outcome(0.2, ("supply_droop",)), constants=True)
    assert found.added == ("supply_droop",) and len(asked) == 3
    enough = dataclasses.replace(part, share_left=EXPLAINED)
    found, asked = passes(usual, enough, constants=True)
    assert found.added == ("constant:supply",) and len(asked) == 2


def test_all_are_tried_where_a_constant_leaves_a_part_of_little():
    """A gain of the current left 0.36 of a jet pipe's dead band, 1.8 noise units."""
    usual = Outcome(4.5)
    gain = Outcome(1.8, ("constant:current_gain",), share_left=EXPLAINED + 0.06)
    found, asked = passes(usual, gain, Outcome(0.7, ("dead_band",)), constants=True)
    assert found.added == ("dead_band",) and len(asked) == 3
    found, asked = passes(usual, gain, Outcome(1.8 * LESS, ("dead_band",)), constants=True)
    assert found.added == ("constant:current_gain",) and len(asked) == 3
    of_effect = dataclasses.replace(gain, names=("load_damping",))
    assert len(passes(of_effect)[1]) == 1


def test_all_are_tried_where_something_is_left():
    found, asked = passes(Outcome(9.0, ("command_delay",)), Outcome(0.2, ("dead_band",)))
    assert found.added == ("dead_band",) and found.seconds > 0
    assert asked == [CATALOGUE, (*CATALOGUE, *EXTENSION, "sensor_offset")]


def test_all_are_tried_on_whole_windows_where_these_leave_something():
    """What drifts has no time to in a quarter of one."""
    drift = Outcome(0.2, ("force_drift",))
    found, asked = passes(Outcome(9.0), Outcome(9.0), on_whole_windows=drift)
    assert found.added == ("force_drift",) and len(asked) == 2
    found, _ = passes(Outcome(9.0), Outcome(5.0, ("creep",)), on_whole_windows=Outcome(4.9, ("force_drift",)))
    assert found.added == ("creep",)  # 4.9 is not below 0.8 of 5
    found, _ = passes(Outcome(9.0), Outcome(1.0, ("creep",)), on_whole_windows=drift)
    assert found.added == ("creep",)


@pytest.mark.parametrize("second", [Outcome(9.0 * LESS + 0.1, ("backlash",)), Outcome(0.1)])
def test_more_effects_that_leave_as_much_do_not_count(second):
    found, _ = passes(Outcome(9.0, ("command_delay",)), second)
    assert found.added == ("command_delay",)


DRY: Any = SimpleNamespace(effects={"thread_friction": ThreadFriction()}, offers=lambda effect: True)
ROUGH = (Presliding, (*CATALOGUE, Presliding))


def test_dry_friction_of_the_card_may_build_up():
    outcomes = Outcome(9.0, declared=DRY), Outcome(1.0, ("presliding", "gravity"), declared=DRY)
    found, asked = passes(*outcomes)
    assert found.added == ("presliding", "gravity")
    assert asked == [CATALOGUE, ROUGH]


def test_all_are_tried_beside_friction_that_builds_up():
    outcomes = (
        Outcome(20.0, declared=DRY),
        Outcome(9.0, ("presliding",), declared=DRY),
        Outcome(1.0, ("slip",)),
    )
    found, asked = passes(*outcomes)
    assert found.added == ("slip",)
    every = (*CATALOGUE, *EXTENSION, "sensor_offset", Presliding)
    assert asked == [CATALOGUE, ROUGH, (Presliding, every)]


def test_it_is_among_all_where_it_does_not_help_alone():
    """Play and bristles hide one another."""
    outcomes = (
        Outcome(9.0, declared=DRY),
        Outcome(8.9, ("presliding",), declared=DRY),
        Outcome(0.7, ("backlash", "presliding"), declared=DRY),
    )
    found, asked = passes(*outcomes)
    assert found.added == ("backlash", "presliding")
    assert asked == [CATALOGUE, ROUGH, (*CATALOGUE, *EXTENSION, "sensor_offset", Presliding)]


def test_all_are_tried_beside_it_where_nothing_is_found_without():
    """A supply that droops behind a rough guide showed on whole windows, once its bristles were there."""
    rough = Outcome(8.9, ("presliding",), declared=DRY)
    outcomes = [Outcome(9.0, declared=DRY), rough, Outcome(9.0), rough]
    both = Outcome(0.7, ("presliding", "supply_droop"))
    every = (*CATALOGUE, *EXTENSION, "sensor_offset", Presliding)
    found, asked = passes(*outcomes, after_bristles=both)
    assert found.added == both.names and asked == [CATALOGUE, ROUGH, every, (Presliding, every)]
    found, asked = passes(*outcomes, on_whole_windows=Outcome(8.9, ("creep",)), after_bristles=both)
    assert not found.added, "something was found without"


def test_nothing_is_tried_beside_bristles_that_are_not_supported():
    outcomes = [Outcome(9.0, declared=DRY) for _ in range(3)]
    found, asked = passes(*outcomes, after_bristles=Outcome(0.7, ("presliding", "supply_droop")))
    assert not found.added and len(asked) == 3


@pytest.mark.parametrize(
    ("before", "names", "left", "counts"),
    [
        (("gravity",), ("gravity", "presliding"), MUCH, False),
        (("gravity",), ("gravity", "presliding"), MUCH + 0.1, True),
        (("gravity",), ("creep", "presliding"), MUCH, True),
        (("gravity", "creep"), ("gravity", "presliding"), MUCH, True),
        ((), ("presliding",), MUCH, True),
    ],
)
def test_a_little_roughness_beside_what_was_found_is_no_finding(before, names, left, counts):
    """Every guide has a little; where nothing else was found, or much is left, bristles count."""
    first, rough = Outcome(left, before, declared=DRY), Outcome(1.0, names, declared=DRY)
    for outcomes in ((first, rough), (first, Outcome(left), rough)):
        found, _ = passes(*outcomes, Outcome(left), Outcome(left))
        assert found.added == (names if counts else before)


def test_constants_are_tried_without_it_where_it_does_not_help_alone():
    outcomes = [Outcome(9.0, declared=DRY) for _ in range(4)]
    _, asked = passes(*outcomes, constants=True)
    assert asked[1:3] == [ROUGH, ("constants", CATALOGUE)]


def test_friction_that_builds_up_on_the_card_is_not_tried_again():
    effects = {"thread_friction": ThreadFriction(), "presliding": Presliding()}
    rough: Any = SimpleNamespace(effects=effects, offers=lambda effect: True)
    _, asked = passes(Outcome(9.0, declared=rough), Outcome(9.0))
    assert len(asked) == 2 and asked[1] == (*CATALOGUE, *EXTENSION, "sensor_offset")


def test_constants_are_tried_where_the_usual_effects_leave_something():
    mass = Outcome(0.2, ("constant:mass",), share_left=0.0)
    found, asked = passes(Outcome(9.0, ("creep",)), mass, constants=True)
    assert found.added == ("constant:mass",)
    assert asked == [CATALOGUE, ("constants", CATALOGUE)]
    found, asked = passes(Outcome(0.9, ("creep",)), constants=True)
    assert found.added == ("creep",) and asked == [CATALOGUE]
    found, asked = passes(Outcome(9.0), Outcome(9.0), Outcome(9.0), constants=True)
    assert found.added == () and asked[1] == ("constants", CATALOGUE) and len(asked) == 3


RADIUS: Any = {"initial_radius": 17.0}


def test_constants_are_tried_where_a_value_ran_from_the_card():
    bent = Outcome(0.3, violated_priors=RADIUS)
    angle = Outcome(0.3, ("constant:braid_angle",), share_left=0.0)
    found, asked = passes(bent, angle, constants=True)
    assert found.added == ("constant:braid_angle",) and asked == [CATALOGUE, ("constants", CATALOGUE)]
    still_bent = Outcome(0.3, ("constant:mass",), violated_priors=RADIUS)
    assert passes(bent, still_bent, constants=True)[0].added == ()
    assert passes(bent, Outcome(4.0, ("constant:mass",)), constants=True)[0].added == ()
    assert len(passes(bent, constants=False)[1]) == 1
