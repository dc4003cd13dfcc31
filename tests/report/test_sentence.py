"""The one plain sentence."""

import dataclasses

from report.fake import diagnosis

from jaxmuscle.diagnosis.diagnosis_data import Estimate, Pattern
from jaxmuscle.effects import BladderStiffness, LoadDamping
from jaxmuscle.report.doubts import doubts
from jaxmuscle.report.sentence import indistinguishable, sentence


def test_effects_found_names_the_fall_and_the_effect() -> None:
    found = diagnosis("effects found")
    errors = [part["held_out"]["position"].rmse * 1e3 for part in (found.before, found.after)]
    fall = f"from {errors[0]:.2f} mm to {errors[1]:.3f} mm"
    assert sentence(found) == (
        f"Position error on unseen data fell {fall} after adding load friction, 16.2 ± 0.4 N."
    )


def test_complete_says_that_nothing_is_missing() -> None:
    text = sentence(diagnosis("complete"))
    assert text.startswith("Nothing is missing: the declared model predicts unseen data to ")
    assert "pressure 0.0040 bar" in text and "position 0.030 mm" in text


def test_unexplained_says_where_and_does_not_guess() -> None:
    text = sentence(diagnosis("unexplained"))
    assert "no effect of the catalogue explains" in text
    assert text.endswith("; it acts on the load and depends on position and velocity.")
    assert not any(word in text for word in ("friction", "damping", "creep"))


def test_a_pattern_of_what_is_left_is_told_in_the_place_of_variables() -> None:
    found = diagnosis("unexplained")
    (left,) = found.unexplained
    shaken = dataclasses.replace(left, pattern=Pattern("tone", "time", 6.7137, "Hz", 0.98))
    text = sentence(dataclasses.replace(found, unexplained=(shaken,)))
    assert text.endswith("; it acts on the load and swings at 6.71 Hz, whatever the machine does.")
    hung = dataclasses.replace(left, pattern=Pattern("constant", "time", -1.234, "m/s^2", 0.8))
    text = sentence(dataclasses.replace(found, unexplained=(hung,)))
    assert text.endswith("; it acts on the load and is mostly constant, about -1.2 m/s².")


def test_what_cannot_be_told_apart_is_said() -> None:
    found = diagnosis("effects found")
    first = found.rounds[0]
    tied = [dataclasses.replace(a, told_apart=a.name != "load_damping") for a in first.ranking]
    doubtful = dataclasses.replace(found, rounds=(dataclasses.replace(first, ranking=tuple(tied)),))
    assert sentence(doubtful).endswith("16.2 ± 0.4 N, from which load damping cannot be told apart here.")


def test_an_effect_that_was_added_later_is_no_rival_of_the_first() -> None:
    found = diagnosis("effects found")
    first = found.rounds[0]
    told = {"load_damping": False, "creep": False}
    ranking = tuple(dataclasses.replace(a, told_apart=told.get(a.name, True)) for a in first.ranking)
    damping = dataclasses.replace(found.effects[0], name="load_damping", parameters={})
    both = dataclasses.replace(
        found,
        effects=(*found.effects, damping),
        rounds=(dataclasses.replace(first, ranking=ranking), found.rounds[1]),
        model=found.model.with_effects(load_damping=LoadDamping(coefficient=3.0)),  # pyright: ignore
    )
    assert indistinguishable(both) == ["creep"]
    assert "from which creep cannot be told apart here." in sentence(both)


def test_an_error_that_stays_large_is_said() -> None:
    found = diagnosis("effects found")
    errors = found.after["held_out"]
    large = dataclasses.replace(errors["position"], in_noise=10.4)
    after = {**found.after, "held_out": {"position": large}}
    text = sentence(dataclasses.replace(found, after=after))
    assert "mm, still 10 times the sensor noise, after adding load friction" in text


def test_an_error_that_did_not_fall_is_not_said_to_fall() -> None:
    found = diagnosis("effects found")
    text = sentence(dataclasses.replace(found, after=found.before))
    assert "did not fall: it went from" in text and " fell " not in text


def test_something_can_be_left_beside_an_added_effect() -> None:
    found = diagnosis("effects found")
    text = sentence(dataclasses.replace(found, verdict="unexplained", after=found.before))
    assert text.startswith("Even with load friction, 16.2 ± 0.4 N, something is missing")


def test_several_parameters_name_the_strength() -> None:
    found = diagnosis("effects found")
    effect = found.effects[0]
    several = dataclasses.replace(
        effect, parameters={**effect.parameters, "width": effect.parameters["force"]}
    )
    assert "load friction (force 16.2 ± 0.4 N)." in sentence(dataclasses.replace(found, effects=(several,)))


def test_of_several_strengths_the_one_that_differs_from_none_is_named() -> None:
    """And of the other one, which ended at a bound, that nothing tells how sure it is."""
    found = diagnosis("effects found")
    own = {
        "stiffness": Estimate(0.0, 0.0, "N", ""),
        "threshold_pressure": Estimate(41330.0, 480.0, "Pa", ""),
    }
    effect = dataclasses.replace(found.effects[0], name="bladder_stiffness", parameters=own)
    model = found.model.with_effects(bladder_stiffness=BladderStiffness())
    bladder = dataclasses.replace(found, effects=(effect,), model=model)
    assert "bladder stiffness (threshold pressure 41.3 ± 0.5 kPa)" in sentence(bladder)
    (told,) = [each for each in doubts(bladder) if "bound" in each]
    assert told.startswith("The stiffness of bladder stiffness ended at a bound of what is physical, 0 N:")


def test_undecided_says_how_much_may_be_missing() -> None:
    text = sentence(diagnosis("undecided"))
    assert text.startswith("No effect is supported by this recording, but something of about 2.3 times")


def test_not_confirmed_gives_both_errors_and_the_value_that_contradicts_the_card() -> None:
    text = sentence(diagnosis("not confirmed"))
    assert text.startswith("Not confirmed: training data support load friction, 16.2 ± 0.4 N, but on unseen")
    assert " before, " in text and " after)." in text
    assert text.endswith("But end factor comes out 4.2 standard deviations from the card.")
