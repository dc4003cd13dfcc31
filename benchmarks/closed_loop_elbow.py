"""The compensator of [W] on rig `elbow`: a PID alone, and with the elbow's own model inside."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from hysteresis_compensation import PUBLISHED
from published_rows import OWN, Row, aside, row

from jaxmuscle.actuators import Elbow
from jaxmuscle.components import PressureRegulator
from jaxmuscle.control import IntegralInversePID, closed_loop, feedback_on
from jaxmuscle.hysteresis import Envelope, IntegralInverse, ModifiedPrandtlIshlinskii, respond

AMBIENT, STEP, SECONDS = 101325.0, 0.02, 100.0
INTEGRAL_TIME, INVERSE_GAIN = 0.5, 3e6
"""T_i [s] and K [Pa/(rad s)]; the model's own error decays in 0.1 s."""


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
