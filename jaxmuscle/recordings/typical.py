"""Typical values of the quantities of a card, each with its source: to read, not to compute with."""

from __future__ import annotations

import dataclasses

from jaxmuscle.formatting import meaning, uncertain
from jaxmuscle.recordings import schema
from jaxmuscle.recordings.schema import Need, Rig
from jaxmuscle.units import example_unit, from_si, is_same_unit


@dataclasses.dataclass(frozen=True)
class Typical:
    """A value that machines of the literature or the samples of the package have.

    Attributes:
        value, unit: as a card would give them; pressures gauge.
        std: standard deviation to begin with, of what a data sheet hardly gives and a fit has to find.
        source: where the value comes from.
    """

    value: float
    unit: str
    source: str
    std: float | None = None

    def __str__(self) -> str:
        """The value with its unit, as a person writes them."""
        return f"{self.number} {self.unit}".rstrip()

    @property
    def number(self) -> str:
        """The value, with its standard deviation, without its unit."""
        return f"{self.value:g}" if self.std is None else uncertain(self.value, self.std)


LIFT, SWING = "sample lift", "sample swing"
TONDU, HENRI, WANG = (
    "Tondu and Lopez 2000",
    "the Utah/MIT jet-pipe actuator",
    "an elbow after Wang et al. 2019",
)
TYPICAL: dict[str, Typical] = {
    "initial_length": Typical(300, "mm", TONDU),
    "initial_radius": Typical(7, "mm", TONDU),
    "braid_angle": Typical(20, "deg", TONDU),
    "end_factor": Typical(1.3, "", TONDU, 0.05),
    "mass": Typical(8, "kg", LIFT),
    "valve_area": Typical(1.2, "mm^2", LIFT, 0.2),
    "valve_time_constant": Typical(7, "ms", LIFT, 1),
    "full_command": Typical(5, "V", LIFT),
    "supply_pressure": Typical(7, "bar", LIFT),
    "regulator_frequency": Typical(14, "Hz", SWING, 1.5),
    "regulator_damping": Typical(0.85, "", SWING),
    "sprocket_radius": Typical(15, "mm", TONDU),
    "initial_contraction": Typical(0.1, "", TONDU),
    "inertia": Typical(0.12, "kg m^2", SWING, 0.02),
    "current_gain": Typical(0.1, "A/V", HENRI),
    "pipe_compliance": Typical(0.8, "mm/N", HENRI, 0.08),
    "pipe_saturation_force": Typical(0.9, "N", HENRI, 0.1),
    "receiver_offset": Typical(0.099, "mm", HENRI, 0.006),
    "discharge_coefficient": Typical(0.696, "", HENRI, 0.03),
    "stopper_position": Typical(48, "mm", HENRI),
    "first_length": Typical(400, "mm", TONDU),
    "first_mass": Typical(4.4, "kg", TONDU),
    "first_centre": Typical(255, "mm", TONDU),
    "first_inertia": Typical(0.078, "kg m^2", TONDU),
    "second_length": Typical(400, "mm", TONDU),
    "second_mass": Typical(0.6, "kg", TONDU),
    "second_centre": Typical(267, "mm", TONDU),
    "second_inertia": Typical(0.011, "kg m^2", TONDU),
    "rising_height": Typical(3, "", WANG),
    "rising_slope": Typical(0.5, "1/bar", WANG),
    "falling_height": Typical(2.8, "", WANG),
    "falling_slope": Typical(0.55, "1/bar", WANG),
    "density": Typical(3.7, "deg", WANG),
    "decay": Typical(1.5, "", WANG),
    "spacing": Typical(0.1, "", WANG),
}
"""Name of a quantity → what it typically is; of those that a card has to give.

The Utah/MIT jet-pipe actuator [H] is taken with a driver of 0.1 A/V, and with the mid-line of its pipe as the
package assumes it; the elbow after Wang et al. [W] has the shape of theirs, not their numbers. The samples
come with the package.
"""


def typical(name: str, need: Need) -> Typical | None:
    """The typical value of a quantity of this name and kind, if one is known."""
    found = TYPICAL.get(name)
    return found if found is not None and is_same_unit(found.unit, need.unit) else None


def meaning_in_card(need: Need) -> str:
    """The meaning of a quantity where a card gives it, gauge or absolute."""
    return need.meaning.removesuffix(", absolute")


def rig_in_words(rig: Rig) -> str:
    """What a rig is, by its docstring."""
    return meaning(rig.__doc__).removeprefix(f"Rig {rig.rig}: ")


def card_unit(name: str, need: Need) -> str:
    """The unit in which a card commonly gives a quantity."""
    found = typical(name, need)
    # A bandwidth is an angular velocity that nobody gives in degrees.
    usual = need.unit if need.unit == "rad/s" else example_unit(need.unit)
    return usual if found is None else found.unit


def default_in_card(rig: Rig, name: str) -> tuple[float, str] | None:
    """(number, unit) of a quantity that a card may leave out; `None` of one that it has to give.

    Pressures absolute.
    """
    value, need = schema.default(rig, name), schema.quantities(rig)[name]
    if value is None:
        return None
    unit = card_unit(name, need)
    return float(f"{from_si(value, unit, need.unit):.6g}"), unit
