"""Every equation of the three source systems: whose docstring cites it by number, and which test checks it.

[T] Tondu and Lopez 2000, [H] the thesis on the jet-pipe actuator, [W] Wang et al. 2019. An equation that
is taken out of its docstring, or a test that goes, fails here.
"""

import ast
import importlib
import inspect
import re
from functools import cache
from pathlib import Path

import pytest

FOLDER = Path(__file__).parent
MUSCLE, FRICTION = "components.mckibben.McKibben", "effects.friction.ThreadFriction"
ANTAGONIST = "components.antagonist"
PIPE, RECEIVER = "components.jet_pipe_valve.JetPipe", "components.jet_pipe_valve.Receiver"
CYLINDER, PISTON = "components.cylinder.Cylinder", "components.cylinder.Piston"
MODIFIED = "hysteresis.prandtl_ishlinskii.ModifiedPrandtlIshlinskii"
JET_TEST = "actuators/test_jet_pipe.py"
SAME = f"{JET_TEST}::test_equals_oracle"
AREAS = f"{JET_TEST}::test_areas_and_leak_are_those_of_the_oracle"
PISTON_SAME = "actuators/test_jet_pipe_piston.py::test_equals_oracle"
GAS, CHAMBER = "components/test_gas.py", "components/test_gas.py"
MUSCLE_TEST, PAIR_TEST = "components/test_mckibben.py", "components/test_antagonist.py"
RUB_TEST, LIFT_TEST = "effects/test_friction.py", "components/test_contraction.py"
LINEAR_TEST = "analysis/test_linear_model.py"
LOOPS_TEST = "hysteresis/test_properties.py"

EQUATIONS = (
    ("[T] 3", f"{MUSCLE}.swelling", f"{MUSCLE_TEST}::test_swelling_follows_the_braid"),
    ("[T] 3", f"{MUSCLE}.volume", f"{MUSCLE_TEST}::test_volume_and_its_slope_equal_the_oracle"),
    ("[T] 4", f"{MUSCLE}.force", f"{MUSCLE_TEST}::test_force_is_the_work_of_the_volume"),
    ("[T] 5", f"{MUSCLE}.force", f"{MUSCLE_TEST}::test_largest_force_of_the_reference_muscle"),
    ("[T] 5", "components.mckibben.largest_contraction",
     f"{MUSCLE_TEST}::test_largest_contraction_in_closed_form"),
    ("[T] 6", "components.mckibben.ThreadMuscle.force",
     "components/test_mckibben.py::test_force_is_equal_over_the_whole_range"),
    ("[T] 7", f"{MUSCLE}.force", f"{MUSCLE_TEST}::test_equals_schultes_form"),
    ("[T] 8", "components.mckibben.largest_contraction",
     f"{MUSCLE_TEST}::test_largest_contraction_of_the_reference_muscle"),
    ("[T] 10", "effects.muscle.PressureDependentEnds",
     "effects/test_forces.py::test_ends_of_the_reference_muscle"),
    ("[T] 11", FRICTION, f"{RUB_TEST}::test_thread_friction_at_rest_is_surface_times_pressure"),
    ("[T] 13", f"{MUSCLE}.contact_surface", f"{MUSCLE_TEST}::test_contact_surface_at_rest"),
    ("[T] 14", f"{MUSCLE}.contact_surface", f"{MUSCLE_TEST}::test_contact_surface_equals_the_oracle"),
    ("[T] 15", FRICTION, f"{RUB_TEST}::test_thread_friction_at_rest_is_surface_times_pressure"),
    ("[T] 16", FRICTION, f"{RUB_TEST}::test_thread_friction_goes_from_static_to_kinetic"),
    ("[T] 17", FRICTION, f"{LIFT_TEST}::test_more_force_while_lengthening_than_while_contracting"),
    ("[T] 18", "actuators.isotonic.Isotonic",
     "actuators/test_isotonic.py::test_lifts_off_when_the_force_reaches_the_weight"),
    ("[T] 18", "components.mckibben.lift_off_pressure",
     f"{LIFT_TEST}::test_lifts_off_at_the_pressure_of_the_closed_form"),
    # The antagonist section counts 17 to 19 again.
    ("[T] 17", f"{ANTAGONIST}.torque", f"{PAIR_TEST}::test_torque_is_that_of_two_muscles"),
    ("[T] 18", f"{ANTAGONIST}.coefficients", f"{PAIR_TEST}::test_largest_torque_and_range_of_the_robot"),
    ("[T] 18", f"{ANTAGONIST}.torque",
     f"{PAIR_TEST}::test_the_quadratic_term_is_about_five_percent_at_the_end_of_the_range"),
    ("[T] 19", f"{ANTAGONIST}.biceps_triceps_torque",
     f"{PAIR_TEST}::test_hogans_form_is_that_of_the_muscles_without_the_quadratic_term"),
    ("[T] 21", f"{ANTAGONIST}.static_gain", f"{PAIR_TEST}::test_static_gain_is_the_slope_of_the_equilibrium"),
    ("[T] 21", f"{ANTAGONIST}.stiffness", f"{PAIR_TEST}::test_stiffness_is_the_slope_of_the_torque"),
    ("[T] 26", "control.sliding_mode.SlidingMode",
     "control/test_sliding_mode.py::test_switching_is_that_of_harashima_on_the_line_of_equation_26"),
    ("[T] 28", "control.sliding_mode.JointModel",
     "control/test_sliding_mode.py::test_follows_a_sine_on_the_joint_that_was_identified"),
    ("[T] 28", "robot.second_order.SecondOrder",
     "robot/test_second_order.py::test_response_equals_an_ode_solver"),
    ("[T] 29", "control.sliding_mode.SlidingMode.equivalent",
     "control/test_sliding_mode.py::test_equation_29_keeps_the_error_on_its_line"),
    *((f"[H] 2.{n}", "components.valves.CurrentDriver.current_rate",
       f"{LINEAR_TEST}::test_driver_and_jet_pipe_of_table_4_1") for n in (1, 2, 3)),
    ("[H] 2.3", "components.valves.CurrentDriver.steady_current",
     "components/test_valves.py::test_settles_at_its_static_characteristic"),
    ("[H] 2.4", f"{PIPE}.tip_force", SAME),
    ("[H] 2.5", f"{PIPE}.static_position", SAME),
    ("[H] 2.6", PIPE, f"{LINEAR_TEST}::test_driver_and_jet_pipe_of_table_4_1"),
    ("[H] 2.7", f"{PIPE}.over_receiver", SAME),
    *((f"[H] 2.{n}", f"{RECEIVER}.supply_areas", AREAS) for n in range(8, 18)),
    *((f"[H] 2.{n}", f"{RECEIVER}.return_areas", AREAS) for n in range(8, 18)),
    *((f"[H] 2.{n}", "components.gas.nozzle_flow", f"{GAS}::test_choked_flow_in_closed_form")
      for n in (18, 19, 20)),
    *((f"[H] 2.{n}", "components.gas.nozzle_flow", f"{GAS}::test_subsonic_flow_follows_the_energy_balance")
      for n in (18, 21, 22)),
    ("[H] 2.23", f"{CYLINDER}.leak", AREAS),
    ("[H] 2.24", "actuators.jet_pipe.JetPipeActuator", SAME),
    ("[H] 2.25", "actuators.jet_pipe.JetPipeActuator", SAME),
    *((f"[H] 2.{n}", "components.gas.ChamberGas", f"{CHAMBER}::test_closed_chamber_is_adiabatic")
      for n in range(26, 30)),
    ("[H] 2.29", f"{CYLINDER}.pressure_rate", SAME),
    ("[H] 2.30", f"{CYLINDER}.volumes", SAME),
    ("[H] 2.31", f"{CYLINDER}.volumes", SAME),
    ("[H] 2.32", CYLINDER, SAME),
    ("[H] 2.32", PISTON, f"{CHAMBER}::test_piston_without_gap_hangs_on_spring_and_stopper"),
    ("[H] 2.33", f"{PISTON}.viscous_force", PISTON_SAME),
    ("[H] 2.34", f"{CYLINDER}.force", f"{JET_TEST}::test_full_jet_force"),
    ("[H] 2.35", f"{PISTON}.dry_limit", f"{CHAMBER}::test_friction_falls_from_stiction_to_coulomb"),
    ("[H] 2.36", f"{CYLINDER}.force", f"{JET_TEST}::test_full_jet_force"),
    *((f"[H] 2.{n}", f"{PISTON}.rod_force", f"{CHAMBER}::test_piston_without_gap_hangs_on_spring_and_stopper")
      for n in (37, 38)),
    ("[H] 4.2", "control.force.ProportionalForce",
     "control/test_force.py::test_feedforward_takes_away_the_error_at_rest"),
    *((f"[H] 4.{n}", "analysis.linear_model.linearise",
       f"{LINEAR_TEST}::test_equals_the_matrices_of_chapter_4") for n in range(3, 34)),
    ("[W] 1", "hysteresis.operators.play",
     "effects/test_hysteresis.py::test_play_follows_its_input_at_a_distance"),
    ("[W] 1", "hysteresis.prandtl_ishlinskii.PrandtlIshlinskii",
     f"{LOOPS_TEST}::test_classical_equals_its_equations"),
    ("[W] 2", MODIFIED, f"{LOOPS_TEST}::test_table_2_equals_its_equations"),
    ("[W] 3", "hysteresis.prandtl_ishlinskii.exponential_density",
     f"{LOOPS_TEST}::test_exponential_density_equals_its_equation"),
    ("[W] 4", "hysteresis.prandtl_ishlinskii.Envelope", f"{LOOPS_TEST}::test_table_2_equals_its_equations"),
    ("[W] 5", "hysteresis.prandtl_ishlinskii.spaced_thresholds",
     f"{LOOPS_TEST}::test_exponential_density_equals_its_equation"),
    ("[W] 6", MODIFIED, f"{LOOPS_TEST}::test_table_2_equals_its_equations"),
    ("[W] 7", "hysteresis.compensation.IntegralInverse",
     "hysteresis/test_compensation.py::test_integral_inverse_approaches_the_analytic_one"),
    ("[W] 7", "control.pid.IntegralInversePID", "control/test_pid.py::test_pid_is_its_equation"),
)  # fmt: skip
"""Equation, object of the package whose docstring cites it, test of it."""
NUMBERS = {
    "T": {3, 4, 5, 6, 7, 8, 10, 11, 13, 14, 15, 16, 17, 18, 19, 21, 26, 28, 29},
    "H": {*(f"2.{n}" for n in range(1, 39)), *(f"4.{n}" for n in range(2, 34))},
    "W": set(range(1, 8)),
}
"""The equations that can be read in the sources. (4.1 of [H] is the form ẋ = g(x, u) of all of them; 27
of [T], where the control variable is split, is not legible.)"""

NUMBER = r"\d+(?:\.\d+)?"
CITATION = re.compile(
    rf"\[(?P<source>[THW])\]\s+\(?(?:before )?\(?(?:equations? )?"
    rf"(?P<numbers>{NUMBER}(?:(?:,\s|\sand\s|\sto\s|-){NUMBER})*)\b"
)


def cited(docstring):
    """The equations that a docstring cites, as ``[T] 4``; ranges are written out."""
    found = set()
    for match in CITATION.finditer(" ".join(docstring.split())):
        last = None
        for part in re.finditer(rf"(?P<link>-| to )?(?P<number>{NUMBER})", match["numbers"]):
            chapter, _, place = part["number"].rpartition(".")
            first = int(last) + 1 if part["link"] and last else int(place)
            prefix = f"[{match['source']}] " + (f"{chapter}." if chapter else "")
            found |= {f"{prefix}{n}" for n in range(first, int(place) + 1)}
            last = place
    return found


def named(dotted):
    """The object of a dotted name below the package."""
    parts = dotted.split(".")
    for end in range(len(parts), 0, -1):
        try:
            thing = importlib.import_module(".".join(["jaxmuscle", *parts[:end]]))
        except ModuleNotFoundError:
            continue
        for part in parts[end:]:
            thing = getattr(thing, part)
        return thing
    raise AssertionError(f"there is no jaxmuscle.{dotted}")


@cache
def functions(file):
    """Names of the test functions in a file of this folder."""
    tree = ast.parse((FOLDER / file).read_text(encoding="utf-8"))
    return {node.name for node in tree.body if isinstance(node, ast.FunctionDef)}


@pytest.mark.parametrize(("equation", "dotted", "test"), EQUATIONS)
def test_is_cited_and_tested(equation, dotted, test):
    docstring = inspect.getdoc(named(dotted)) or ""
    assert equation in cited(docstring), f"{dotted} cites {sorted(cited(docstring))}"
    file, function = test.split("::")
    assert function.startswith("test_") and function in functions(file)


def test_no_equation_is_left_out():
    listed = {equation for equation, _, _ in EQUATIONS}
    assert listed == {f"[{source}] {n}" for source, numbers in NUMBERS.items() for n in numbers}


@pytest.mark.parametrize(
    ("docstring", "expected"),
    [
        ("Force, [T] equations 4, 5 and 7: F.", {"[T] 4", "[T] 5", "[T] 7"}),
        ("Thesis [H] 2.18 to 2.20, and [H] 2.29.", {"[H] 2.18", "[H] 2.19", "[H] 2.20", "[H] 2.29"}),
        ("Of [W] (2-4), [W] before (1).", {"[W] 2", "[W] 3", "[W] 4", "[W] 1"}),
        ("No number in [T], nor here: 4. [H] section 2.4 is none.", set()),
    ],
)
def test_citations_are_read(docstring, expected):
    assert cited(docstring) == expected
