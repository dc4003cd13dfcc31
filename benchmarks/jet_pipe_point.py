"""Table 4.1 and the static figures of [H]: poles, zero, gain, forces."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jet_pipe_rows import ABSOLUTE, GAIN, SLOPE, STOPPER, actuator
from published_rows import OWN, Row, aside, near, row

from jaxmuscle.analysis import LinearModel, OperatingPoint, equilibrium, equilibrium_at, linearise
from jaxmuscle.components import Piston

FORCE = 45.0
"""Of Table 4.1 [N]."""
FEEDBACK = 0.044
"""k_p of [H] 4.2.1 [A/N]."""


@cache
def operating_point() -> tuple[OperatingPoint, LinearModel]:
    point = equilibrium_at(actuator(), "force", FORCE, command=1.0)
    return point, linearise(actuator(), point)


def pole_rows() -> Iterator[Row]:
    point, model = operating_point()
    source, poles = "[H] Table 4.1", np.asarray(model.poles())
    digits = "the digits that are printed"
    force = float(point.readings[1])
    yield aside(near(source, "force of the operating point", FORCE, force, "N", 1e-6, "solved for"), OWN)
    driver, lag = float(poles[5].real), float(poles[2].real)
    swing = [float(poles[3].real), abs(float(poles[3].imag))]
    yield near(source, "pole of the current driver", -7049.7, driver, "rad/s", 1e-4, "2.3 says 7050")
    yield near(source, "pole of the jet pipe's lag", -973.9, lag, "rad/s", 1e-4, digits)
    ok = abs(swing[0] + 35.3) < 0.06 and abs(swing[1] - 1856.3) < 0.1
    resonance = "poles of the jet pipe's resonance, real and imaginary"
    yield row(source, resonance, "-35.3 ± 1856.3j", swing, ok, "rad/s", "last digit", digits)
    what = "the ambient pressure and temperature of the thesis are not given"
    for goal, pole in zip((-5.0, -14.5), poles[:2], strict=True):
        yield near(source, f"fluid pole {goal:g}", goal, float(pole.real), "rad/s", 0.1, what)
    hertz = float(-poles[1].real) / (2 * np.pi)
    yield near(source, "dominant fluid pole", 2.3, hertz, "Hz", 0.1, what)
    zero = float(model.zeros("force")[0].real)
    yield near(
        source, "zero of the fluid", -7.1, zero, "rad/s", 0.1, what,
        f"under another reading, {ABSOLUTE}, poles and zero agree within 10 % (rows below, not counted), but "
        "the rated force of the full jet speaks against it; at 551.6 kPa gauge -5.1 by hand too",
    )  # fmt: skip
    cancelled = abs(zero / float(poles[0].real) - 1)
    yield row(
        "[H] 4.2.2", "zero lies beside the slow pole and cancels it", "very close", cancelled,
        cancelled < 0.2, "relative distance", "0.2", "one word, no number",
    )  # fmt: skip


def gain_rows() -> Iterator[Row]:
    _, model = operating_point()
    gain = float(model.gain("force") / model.gain("current"))
    yield near("[H] 4.2.1", "static gain at 45 N", 550.0, gain, "N/A", 0.1, "read off Figure 3.13", SLOPE)
    pole = float(-np.asarray(model.poles())[1].real)
    loop = (1 + FEEDBACK * gain) * pole / (2 * np.pi)
    yield near("[H] 4.2.1", "bandwidth a + k_p k a with k_p = 0.044 A/N", 55.0, loop, "Hz", 0.1,
               "follows from k", f"k is {gain:.0f} N/A, not 550: {SLOPE}")  # fmt: skip
    pipe = actuator().pipe
    travel = np.diff(np.asarray(pipe.static_position(pipe.tip_force(jnp.array([-0.4, 0.4])))))
    yield near("[H] 3.2.1", "travel of the tip over ±0.4 A", 1.0, 1e3 * float(travel[0]), "mm", 0.15,
               "read off Figure 3.4")  # fmt: skip
    tip = actuator(pipe__receiver_offset=0.9652e-3)
    full = float(equilibrium(tip, 0.0).readings[1])
    by_hand = near("[H] 2.18-2.38", "force with the tip right over port 1", 102.0, full, "N", 0.01,
                   "the equations evaluated by hand; not in the thesis")  # fmt: skip
    yield aside(by_hand, OWN)
    yield near("[H] chapter 2", "rated force at 80 psig", 111.25, full, "N", 0.1,
               "A_p times the supply pressure is 109 N; the leak past the piston takes 7 N")  # fmt: skip
    volts = jnp.array([0.2, 0.4]) / GAIN
    at = jax.vmap(lambda u: equilibrium(actuator(), u).readings[1])(volts)
    share = float(at[0] / at[1])
    yield row("[H] 3.3.2", "static force at half the rated current, of that at the rated one",
              "almost at its maximum", share, share > 0.85, "", "> 0.85", "in words",
              "" if share > 0.85 else SLOPE)  # fmt: skip
    kind: Any = Piston
    residual = float(kind().rod_force(STOPPER - 0.026, 0.0))
    small = 0 < residual < 0.1 * full
    yield row("[H] 2.38, Table 3.1", "residual pull of the spring, the piston at the end", "some N, in words",
              residual, small, "N", "a tenth of the full force", "low spring rate")  # fmt: skip
