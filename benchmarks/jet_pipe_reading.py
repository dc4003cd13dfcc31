"""Where [H] leaves open what it assumed: readings with which the published numbers agree with each other."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache

import jax
import jax.numpy as jnp
import numpy as np
from jet_pipe_bandwidth import over_stoppers, power, response_bandwidths
from jet_pipe_point import FEEDBACK, FORCE
from jet_pipe_rows import ABSOLUTE, AMBIENT, GAIN, SUPPLY, actuator
from published_rows import Row, near, row
from scipy.optimize import fsolve

from jaxmuscle.actuators import JetPipeActuator
from jaxmuscle.analysis import LinearModel, equilibrium, equilibrium_at, linearise


def linear(machine: JetPipeActuator) -> LinearModel:
    """About the operating point of Table 4.1."""
    return linearise(machine, equilibrium_at(machine, "force", FORCE, command=1.0))


def static_gain(machine: JetPipeActuator) -> float:
    """[N/A] at 45 N."""
    model = linear(machine)
    return float(model.gain("force") / model.gain("current"))


@cache
def with_mid_line(supply: float) -> JetPipeActuator:
    """The actuator with the mid-line that has 550 N/A at 45 N and 1 mm over ±0.4 A, as published."""

    def pipe(numbers: np.ndarray) -> JetPipeActuator:
        return actuator(
            pipe__compliance=1e-3 * numbers[0], pipe__saturation_force=numbers[1],
            receiver__supply_pressure=supply,
        )  # fmt: skip

    def missed(numbers: np.ndarray) -> list[float]:
        machine = pipe(numbers)
        ends = machine.pipe.static_position(1.946 * jnp.array([-0.4, 0.4]))
        return [static_gain(machine) / 550 - 1, 1e3 * float(ends[1] - ends[0]) - 1]

    found = np.asarray(fsolve(missed, [1.0, 0.5]))
    print(f"    mid-line through 550 N/A and 1 mm, supply of {supply / 1e3:.1f} kPa absolute: "
          f"{found[0]:.3f} mm/N, saturating at {found[1]:.3f} N")  # fmt: skip
    return pipe(found)


def reading_rows() -> Iterator[Row]:
    source, machine = "[H] Table 4.1", actuator(receiver__supply_pressure=SUPPLY)
    model = linear(machine)
    poles, zero = np.real(np.asarray(model.poles())), float(model.zeros("force")[0].real)
    for name, goal, ours in zip(("slow pole", "fast pole", "zero"), (-5.0, -14.5, -7.1), (*poles[:2], zero),
                                strict=True):  # fmt: skip
        yield near(source, f"{name} of the fluid, {ABSOLUTE}", goal, float(ours), "rad/s", 0.1,
                   "the thesis gives no atmospheric pressure")  # fmt: skip
    full = float(equilibrium(actuator(pipe__receiver_offset=0.9652e-3, receiver__supply_pressure=SUPPLY), 0.0)
                 .readings[1])  # fmt: skip
    print(f"    against that reading: the full jet gives {full:.0f} N, the actuator is rated for 111 N")
    pole = power(over_stoppers(0.042, SUPPLY)["pole"][:, 2])
    yield row("[H] Figure 4.12", f"power of chamber 1's volume in the dominant fluid pole, {ABSOLUTE}", "-1",
              pole, abs(pole + 1) < 0.25, "", "0.25", "in words, chamber 2 kept")  # fmt: skip
    corners = [power(over_stoppers(kept, supply)["bandwidth"][:, 2]) for supply in (None, SUPPLY)
               for kept in (0.042, None)]  # fmt: skip
    print("    power of chamber 1's volume in the -3 dB corner at 45 N, gauge and absolute supply, chamber 2 "
          "kept and shrinking: " + ", ".join(f"{p:.2f}" for p in corners))  # fmt: skip
    line = "mid-line through 550 N/A and 1 mm"
    gauge = with_mid_line(AMBIENT + SUPPLY)
    at = jax.vmap(lambda u: equilibrium(gauge, u).readings[1])(jnp.array([0.2, 0.4]) / GAIN)
    share = float(at[0] / at[1])
    yield row("[H] 3.3.2", f"static force at half the rated current, {line}", "almost at its maximum", share,
              share > 0.85, "", "> 0.85", "in words")  # fmt: skip
    corner = float(-np.asarray(linear(gauge).poles())[1].real) / (2 * np.pi)
    yield near("[H] 4.2.1", f"bandwidth a + k_p k a, {line}", 55.0,
               (1 + FEEDBACK * static_gain(gauge)) * corner, "Hz", 0.1, "k is fitted, a is not")  # fmt: skip
    hertz = response_bandwidths(with_mid_line(SUPPLY))
    by_mean, by_size = ([float(x) for x in found] for found in (hertz[:, 1], hertz[1]))
    for what, found in (("mean", by_mean), ("amplitude", by_size)):
        yield row("[H] Figures 3.15, 3.16", f"bandwidth rises with the {what}, {ABSOLUTE}, {line}",
                  "slightly", found, found[2] > found[0], "Hz", "sign", "in words")  # fmt: skip
