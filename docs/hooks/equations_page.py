"""Page of equations: docstrings of components, hysteresis and rigs, which give each one and its source."""

from __future__ import annotations

import inspect
import re
from collections.abc import Iterator
from typing import Any

from docstring_markup import as_markdown

from jaxmuscle.actuators import RIGS
from jaxmuscle.components import antagonist, cylinder, gas, jet_pipe_valve, mckibben, valves
from jaxmuscle.hysteresis import compensation, frame, operators, prandtl_ishlinskii
from jaxmuscle.robot import arm, second_order

SECTIONS = (
    ("Gas", (gas.nozzle_flow, gas.ChamberGas)),
    ("Valves", (valves.FlowValve, valves.PressureRegulator, valves.CurrentDriver)),
    ("Jet pipe and cylinder", (jet_pipe_valve.JetPipe, jet_pipe_valve.Receiver,
                               cylinder.Cylinder, cylinder.Piston)),
    ("Muscle", (mckibben.McKibben, mckibben.ThreadMuscle, mckibben.largest_contraction,
                mckibben.lift_off_pressure, mckibben.isotonic_contraction)),
    ("Antagonistic joint", (antagonist.coefficients, antagonist.torque, antagonist.biceps_triceps_torque,
                            antagonist.static_gain, antagonist.stiffness)),
    ("Hysteresis", (operators.play, operators.stop, operators.dahl, operators.dahl_between_limits,
                    prandtl_ishlinskii.PrandtlIshlinskii, prandtl_ishlinskii.ExponentialPrandtlIshlinskii,
                    prandtl_ishlinskii.ModifiedPrandtlIshlinskii,
                    prandtl_ishlinskii.GeneralizedPrandtlIshlinskii,
                    prandtl_ishlinskii.Envelope, frame.FrameRule, compensation.IntegralInverse)),
    ("Robot", (arm.Arm, second_order.SecondOrder)),
    ("Rigs", tuple(RIGS.values())),
)  # fmt: skip
INTRODUCTION = """# Equations

Every equation with its source, as the code has it: this page is generated from the docstrings of what
computes them. Letters in brackets are [the three published systems](sources.md) that the package takes
up. The equations of effects stand in the [reference of effects](../reference/effects.md).

**Signs and units.** Contraction +, tension +, flow into a chamber +. SI throughout; pressures are absolute
unless a name says gauge.

**The chain.** An actuator is a causal chain of named signals: command, opening, mass flow, pressure, force,
motion, readings. An effect is an addition to one of them.
"""
ARGUMENTS = re.compile(r"^(Args|Returns|Raises|Attributes|Class variables):", re.M)


def equations_page() -> str:
    """The page."""
    parts = [INTRODUCTION]
    for title, things in SECTIONS:
        parts.append(f"## {title}\n")
        for thing in things:
            parts += _entry(thing)
    return "\n".join(parts)


def _entry(thing: Any) -> Iterator[str]:
    yield f"### {_title(thing)}\n"
    yield f"{_equations(thing)}\n"
    methods = (
        [each for name, each in vars(thing).items() if not name.startswith("_")]
        if inspect.isclass(thing)
        else []
    )
    for method in methods:
        if inspect.isfunction(method) and "math:" in (method.__doc__ or ""):
            yield f"`{method.__name__}`\n:   " + _equations(method).replace("\n", "\n    ") + "\n"


def _title(thing: Any) -> str:
    rig = getattr(thing, "rig", None)
    return f"`{rig}`" if isinstance(rig, str) else f"`{thing.__name__}`"


def _equations(thing: Any) -> str:
    """A docstring up to its arguments."""
    text = inspect.cleandoc(thing.__doc__ or "")
    found = ARGUMENTS.search(text)
    return as_markdown(text[: found.start()].strip() if found else text)
