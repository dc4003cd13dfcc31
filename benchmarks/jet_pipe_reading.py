"""Where [H] leaves open what it assumed: other readings, under which some published numbers agree better.

None of these rows is counted: each number is, under the declared reading, in the other parts of the table.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache

import jax
import jax.numpy as jnp
import numpy as np
from jet_pipe_bandwidth import over_stoppers, power, response_bandwidths
from jet_pipe_point import FEEDBACK, FORCE
from jet_pipe_rows import ABSOLUTE, AMBIENT, GAIN, SUPPLY, actuator
from published_rows import OTHER, Row, as_printed, aside, row
from scipy.optimize import fsolve

from jaxmuscle.actuators import JetPipeActuator
from jaxmuscle.analysis import LinearModel, equilibrium, equilibrium_at, linearise

LINE = "mid-line through 550 N/A and 1 mm"


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
        ends = machine.pipe.static_position(machine.pipe.tip_force(jnp.array([-0.4, 0.4])))
        return [static_gain(machine) / 550 - 1, 1e3 * float(ends[1] - ends[0]) - 1]

    found = np.asarray(fsolve(missed, [1.0, 0.5]))
    print(f"    mid-line through 550 N/A and 1 mm, supply of {supply / 1e3:.1f} kPa absolute: "
          f"{found[0]:.3f} mm/N, saturating at {found[1]:.3f} N")  # fmt: skip
    return pipe(found)


def reading_rows() -> Iterator[Row]:
    for reading, rows in ((ABSOLUTE, absolute_rows), (f"551.6 kPa gauge; {LINE}", line_rows),
                          (f"{ABSOLUTE}; {LINE}", both_rows)):  # fmt: skip
        for entry in rows():
            yield aside({**entry, "reading": reading}, OTHER)


def absolute_rows() -> Iterator[Row]:
    """The supply pressure taken as absolute."""
    source, machine = "[H] Table 4.1", actuator(receiver__supply_pressure=SUPPLY)
    model = linear(machine)
    poles, zero = np.real(np.asarray(model.poles())), float(model.zeros("force")[0].real)
    for name, goal, ours in zip(("slow pole", "fast pole", "zero"), ("-5.0", "-14.5", "-7.1"),
                                (*poles[:2], zero), strict=True):  # fmt: skip
        off = f"{100 * abs(ours / float(goal) - 1):.0f} % off"
        yield as_printed(source, f"{name} of the fluid", goal, float(ours), "rad/s", off)
    port = float(machine.receiver.port_diameter)
    tip = actuator(pipe__receiver_offset=port, receiver__supply_pressure=SUPPLY)
    full = float(equilibrium(tip, 0.0).readings[1])
    yield as_printed("[H] Table 2.1", "rated force at 80 psig", "111.25", full, "N",
                     "this speaks against the reading: less the atmosphere on the other side of the piston, "
                     "too little pressure is left")  # fmt: skip
    pole = power(over_stoppers(0.042, SUPPLY)["pole"][:, 2])
    yield row("[H] Figure 4.12", "power of chamber 1's volume in the dominant fluid pole", "-1",
              pole, abs(pole + 1) < 0.25, "", "0.25", "in words, chamber 2 kept")  # fmt: skip
    corners = [power(over_stoppers(kept, supply)["bandwidth"][:, 2]) for supply in (None, SUPPLY)
               for kept in (0.042, None)]  # fmt: skip
    print("    power of chamber 1's volume in the -3 dB corner at 45 N, gauge and absolute supply, chamber 2 "
          "kept and shrinking: " + ", ".join(f"{p:.2f}" for p in corners))  # fmt: skip


def line_rows() -> Iterator[Row]:
    """The mid-line of the pipe put through two of the published numbers."""
    gauge = with_mid_line(AMBIENT + SUPPLY)
    at = jax.vmap(lambda u: equilibrium(gauge, u).readings[1])(jnp.array([0.2, 0.4]) / GAIN)
    share = float(at[0] / at[1])
    yield row("[H] 3.3.2", "static force at half the rated current", "almost at its maximum", share,
              share > 0.85, "", "> 0.85", "in words")  # fmt: skip
    corner = float(-np.asarray(linear(gauge).poles())[1].real) / (2 * np.pi)
    yield as_printed("[H] 4.2.1", "bandwidth a + k_p k a", "55", (1 + FEEDBACK * static_gain(gauge)) * corner,
                     "Hz", "k is fitted to 550 N/A, a is not")  # fmt: skip


def both_rows() -> Iterator[Row]:
    """The mid-line so fitted, with the supply pressure taken as absolute."""
    hertz = response_bandwidths(with_mid_line(SUPPLY))
    by_mean, by_size = ([float(x) for x in found] for found in (hertz[:, 1], hertz[1]))
    for what, found in (("mean", by_mean), ("amplitude", by_size)):
        yield row("[H] Figures 3.15, 3.16", f"bandwidth rises with the {what}", "slightly", found,
                  found[2] > found[0], "Hz", "sign", "in words")  # fmt: skip
