"""The compensator of [W] on rig `elbow`: a PID alone, and with the elbow's own model inside."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from hysteresis_compensation import PUBLISHED
from published_rows import OWN, WORDS, Row, aside, row

import jaxmuscle as jm
from jaxmuscle.actuators import Elbow
from jaxmuscle.components import PressureRegulator
from jaxmuscle.control import IntegralInversePID, ScheduledPID, closed_loop, feedback_on
from jaxmuscle.hysteresis import Envelope, IntegralInverse, ModifiedPrandtlIshlinskii, respond

AMBIENT, STEP, SECONDS = 101325.0, 0.02, 100.0
INTEGRAL_TIME, INVERSE_GAIN = 0.5, 3e6
"""T_i [s] and K [Pa/(rad s)]; the model's own error decays in 0.1 s."""

RANGES, WEARING = 3, 2e4
"""Ranges of the scheduled PID; rate of the command that costs as much as the error of the one PID [Pa/s]."""


def elbow() -> Elbow:
    """An elbow of 0 to 90 degrees over 0 to 6 bar with an unsymmetric loop ([W] Table 2 makes none)."""
    kind: Any = Elbow
    regulator: Any = PressureRegulator
    envelope: Any = Envelope
    model: Any = ModifiedPrandtlIshlinskii
    rising, falling = envelope(3.0, 5e-6, -1.6, 2.76), envelope(2.8, 5.5e-6, -1.2, 2.33)
    return kind(regulator(6.0, 0.9), model(rising, falling, 0.065, 1.5, 0.1, 1e-7, 1e-19))


def target(times: Any) -> Any:
    """[W] 4.1: a sine of 50 s within what the elbow reaches, between 0.3 bar going down and 5.5 bar [rad]."""
    top, bottom = np.asarray(respond(elbow().hysteresis, [5.5e5, 3e4])[1])
    return 0.5 * (top + bottom) + 0.5 * (top - bottom) * np.sin(np.pi * times / 25 - np.pi / 2)


def elbow_rows() -> Iterator[Row]:
    machine, times = elbow(), np.arange(0, SECONDS, STEP)
    wanted, kind = target(times), IntegralInversePID
    ahead: Any = IntegralInverse
    start = {"pressure": np.asarray(AMBIENT)}

    @jax.jit
    def left(gain: Any, model: Any) -> Any:
        """Root mean square error of the second period, of the range."""
        inverse = None if model is None else ahead(model, INVERSE_GAIN)
        pid = kind(inverse, gain, jnp.asarray(INTEGRAL_TIME), jnp.asarray(0.0))
        loop = feedback_on(machine, pid)
        found = closed_loop(machine, loop, wanted, times, begin=loop.start(0.0), start=start)
        error = (found.readings["angle"] - wanted)[len(times) // 2 :]
        return jnp.sqrt(jnp.mean(error**2)) / np.ptp(wanted)

    goal, low, high = PUBLISHED["PID"] / 90, np.log(1e3), np.log(1e6)
    ends = [float(left(jnp.exp(end), None)) for end in (low, high)]
    if not ends[0] > goal > ends[1]:
        raise RuntimeError(
            f"no gain from {np.exp(low):.0e} to {np.exp(high):.0e} Pa/rad leaves {goal:.3g} of the range: "
            f"the ends leave {ends[0]:.3g} and {ends[1]:.3g}"
        )
    for _ in range(12):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if float(left(jnp.exp(middle), None)) > goal else (low, middle)
    gain = jnp.exp(0.5 * (low + high))
    alone, helped = float(left(gain, None)), float(left(gain, machine.hysteresis))
    ratio, published = helped / alone, PUBLISHED["modified"] / PUBLISHED["PID"]
    print(f"    K_p = {float(gain):.3g} Pa/rad: {100 * alone:.2f} % of the range by the PID, "
          f"{100 * helped:.3f} % with the model inside")  # fmt: skip
    exact = row("[W] 4.1", "rig elbow: modified model inside over PID alone, rms error", f"{published:.2f}",
                ratio, ratio <= published, "", "not more",
                "the model inside is the elbow itself; a PID as good as theirs")  # fmt: skip
    yield aside(exact, OWN)
    yield from scheduled_rows(gain, alone, helped)


def scheduled_rows(gain: Any, alone: float, helped: float) -> Iterator[Row]:
    """Gains by range of the angle, tuned by gradient from those of the one PID; then with the model inside.

    `alone`, `helped`: errors of the one PID, and of it with the model inside, of the range.
    """
    machine, times = elbow(), np.arange(0, SECONDS, STEP)
    wanted = np.asarray(target(times))
    edges = wanted.min() + np.ptp(wanted) * np.arange(1, RANGES) / RANGES
    kind, ahead = ScheduledPID, IntegralInverse
    start = {"pressure": np.asarray(AMBIENT)}
    scenario = jm.tuning.Scenario(wanted, times, start=start)
    sizes = {"tracking": PUBLISHED["PID"] / 90 * float(np.ptp(wanted)), "variation": WEARING}
    found = {}
    for name, model in (("alone", None), ("with the model inside", machine.hysteresis)):
        make: Any = ahead
        inverse = None if model is None else make(model, INVERSE_GAIN)
        one: Any = np.full(RANGES, float(gain)), np.full(RANGES, INTEGRAL_TIME), np.zeros(RANGES)
        tuned = jm.tune(machine, kind(inverse, edges, *one), scenario, sizes, starts=1, steps=20)
        loop = feedback_on(machine, tuned.controller)
        angle = closed_loop(machine, loop, wanted, times, start=start).readings["angle"]
        error = (np.asarray(angle) - wanted)[len(times) // 2 :]
        found[name] = float(np.sqrt(np.mean(error**2)) / np.ptp(wanted))
        gains = ", ".join(f"{n} {v:.3g}" for n, v in tuned.values.items())
        print(f"    scheduled PID {name}: {100 * found[name]:.3f} % of the range; {gains}")
    better = found["alone"] / alone
    entry = row("[W] 4.2", f"rig elbow: PID scheduled over {RANGES} ranges over the one PID, rms error",
                "better", better, better < 1, "", "< 1", "in words; its Table 3 is not legible: tuned here",
                "the commands may vary no more")  # fmt: skip
    yield aside(entry, WORDS)
    ratio, published = (
        found["with the model inside"] / found["alone"],
        PUBLISHED["modified"] / PUBLISHED["PID"],
    )
    inside = row("[W] 4.2", "rig elbow: scheduled PID with modified model inside over it alone, rms error",
                 f"{published:.2f}", ratio, ratio <= published, "", "not more",
                 f"the model is the elbow itself; of the one PID it leaves {helped / alone:.2f}")  # fmt: skip
    yield aside(inside, OWN)
