"""Dry friction: in the muscle's braid, in the guide or bearing of the load and in seals; how it builds up."""

from __future__ import annotations

from typing import ClassVar, NamedTuple

import jax.numpy as jnp
from jaxtyping import Array

from jaxmuscle.effects.base import AbstractFrictionEffect, AbstractSlipEffect
from jaxmuscle.effects.contacts import CONTACTS
from jaxmuscle.effects.slip import DAMPING_TIME
from jaxmuscle.hysteresis.operators import dahl_between_limits
from jaxmuscle.parameters import Scalar, parameter
from jaxmuscle.signals import LOAD, MUSCLE_FORCE, Signals


class ThreadFriction(AbstractFrictionEffect):
    r"""Dry friction between the threads of the braid, larger in motion than at rest.

    .. math:: F_{max} = f\,S(ε)\,P,\quad f = f_k + (f_s - f_k)\,e^{-|\dot x|/\dot x_s}

    [T] equations 11 and 15 to 17; f_s, f_k here are f_s/n, f_k/n there. S: contact surface [m²],
    P: gauge pressure [Pa], ẋ: contraction velocity [m/s].
    """

    name: ClassVar = "thread_friction"
    slot: ClassVar = MUSCLE_FORCE
    reads: ClassVar = frozenset({"muscle", "pressure", "contraction_velocity"})
    strength: ClassVar = "static_coefficient"
    further_strengths: ClassVar = ("kinetic_coefficient",)
    largest: ClassVar = 1.0
    starts: ClassVar = ({"static_coefficient": 0.015, "kinetic_coefficient": 0.06},)
    source: ClassVar = "[T] equations 11, 15-17"

    static_coefficient: Scalar = parameter(
        "", "static friction coefficient f_s/n", default=0.0, nonnegative=True
    )
    kinetic_coefficient: Scalar = parameter(
        "", "kinetic friction coefficient f_k/n", default=0.0, nonnegative=True, typical=0.06
    )
    velocity_constant: Scalar = parameter(
        "m/s", "velocity over which static turns into kinetic friction", default=0.15, positive=True
    )

    def limit(self, signals: Signals) -> Array:
        surface = signals.muscle.contact_surface(signals.contraction)
        fading = jnp.exp(-jnp.abs(signals.contraction_velocity) / self.velocity_constant)
        f = self.kinetic_coefficient + (self.static_coefficient - self.kinetic_coefficient) * fading
        return f * surface * jnp.maximum(signals.gauge_pressure, 0.0)


class LoadFriction(AbstractFrictionEffect):
    """Coulomb friction of the load's guide or bearing: a constant force (on a joint a torque) F_c."""

    name: ClassVar = "load_friction"
    slot: ClassVar = LOAD
    reads: ClassVar = frozenset({"velocity"})
    strength: ClassVar = "force"
    starts: ClassVar = ({},)
    source: ClassVar = "Coulomb, [H] 2.35"

    force: Scalar = parameter("{load}", "Coulomb friction of the guide", default=0.0, nonnegative=True)

    def limit(self, signals: Signals) -> Array:
        return self.force + 0.0 * signals.velocity


class Stribeck(AbstractFrictionEffect):
    r"""Dry friction of the load that is larger at standstill than in motion: what it is larger by.

    .. math:: F_{max} = F_e\,e^{-|v|/v_s}

    The Stribeck part of Canudas de Wit et al. (IEEE Trans. Automatic Control 40, 1995) with exponent 1,
    beside the constant one of `load_friction`: with F_c there, breakaway takes F_c + F_e. v: velocity of
    the load [m/s or rad/s].
    """

    name: ClassVar = "stribeck"
    slot: ClassVar = LOAD
    reads: ClassVar = frozenset({"velocity"})
    strength: ClassVar = "excess"
    starts: ClassVar = tuple({"velocity_constant": v} for v in (0.01, 0.1, 0.5))
    source: ClassVar = "Stribeck; Canudas de Wit et al. 1995, equation 6"

    excess: Scalar = parameter(
        "{load}", "breakaway friction above that in motion", default=0.0, nonnegative=True
    )
    velocity_constant: Scalar = parameter(
        "{motion}/s", "velocity over which the excess falls to 1/e", default=0.05, positive=True
    )

    def limit(self, signals: Signals) -> Array:
        return self.excess * jnp.exp(-jnp.abs(signals.velocity) / self.velocity_constant)


class PressureDependentFriction(AbstractFrictionEffect):
    r"""Dry friction of the load in proportion to the gauge pressure: seals, and bearings that muscles load.

    .. math:: F_{max} = μ_p \sum_i \max(P_i, 0)

    P_i: gauge pressures of the muscles that move the load, or of both chambers of its piston [Pa].
    Friction of pneumatic cylinders grows with the pressures of the chambers: Andrighetto, Valdiero and
    Carlotto, ABCM Symposium Series in Mechatronics 2, 2006.
    """

    name: ClassVar = "pressure_dependent_friction"
    slot: ClassVar = LOAD
    reads: ClassVar = frozenset({"velocity", "pressure"})
    strength: ClassVar = "coefficient"
    starts: ClassVar = ({},)
    source: ClassVar = "seal friction, Andrighetto et al. 2006"

    coefficient: Scalar = parameter(
        "{load}/Pa", "friction per gauge pressure", default=0.0, nonnegative=True, typical=1e-5
    )

    def limit(self, signals: Signals) -> Array:
        gauge = jnp.maximum(signals.gauge_pressure, 0.0)
        # The muscles of one joint, or the chambers of one piston, lie side by side.
        return self.coefficient * gauge.reshape((*jnp.shape(signals.velocity), -1)).sum(-1)


class Bent(NamedTuple):
    """Bristles of each contact after a step: bend, limit over that at rest; place and velocity there."""

    bend: Array
    ratio: Array
    place: Array
    velocity: Array


class Presliding(AbstractSlipEffect):
    r"""Dry friction builds up over a small elastic deflection before anything slides.

    .. math:: f = L_0 \left(z + T \dot z\right),\quad
              \frac{dz}{dx} = \frac{1 - (z/c)\,\mathrm{sgn}\,\dot x}{δ},\quad c = \frac{L(\dot x)}{L_0}

    LuGre (Canudas de Wit et al., IEEE Trans. Automatic Control 40, 1995, equations 1 to 3) with
    :math:`σ_0 = L_0/δ` and :math:`σ_1 = T σ_0`; Dahl (1968), exponent 1, where the limit L of all dry
    friction of a contact, L_0 at rest, does not change with the velocity. The threads of the muscles
    (`thread_friction`) are one contact, guide or bearing of the load (`load_friction`, `stribeck`, …) another
    one, with bristles of their own that bend by the same δ. Without such friction nothing changes. z is
    exact over straight moves x [m or rad] at a constant c, and of second order where c changes in a step
    (:func:`~jaxmuscle.hysteresis.operators.dahl_between_limits`): in two parts, up to the middle of the step
    and from there on, or up to where the motion turns round, and back. T is the
    `damping_time` (:func:`jaxmuscle.effects.slip.slip_of_mass`). Valid from δ = 0, the law without bristles,
    upwards.
    """

    name: ClassVar = "presliding"
    slot: ClassVar = LOAD
    reads: ClassVar = frozenset({"slip"})
    strength: ClassVar = "distance"
    starts: ClassVar = tuple({"distance": distance} for distance in (1e-4, 5e-4, 2e-3, 1e-2))
    source: ClassVar = "Dahl 1968; Canudas de Wit et al. 1995"

    distance: Scalar = parameter(
        "{motion}", "way over which friction builds up to 1 - 1/e", default=0.0, nonnegative=True
    )

    damping_time: Scalar = parameter(
        "s", "damping of the deflection over its stiffness", default=DAMPING_TIME, positive=True
    )

    def initial(self, signals: Signals) -> Bent:
        place, velocity = _motion(signals)
        straight = jnp.zeros((CONTACTS, *jnp.shape(place)))
        return Bent(straight, straight + signals.limit_over_rest, place, velocity)

    def update(self, memory: Bent, signals: Signals, step: Array) -> Bent:
        place, velocity = _motion(signals)
        before, way = memory.velocity, place - memory.place
        turns = before * velocity < 0
        # At an even deceleration the motion turns round after h v0/(v0 - v1), where it rests; where it goes
        # on, so much of the way lies in the first half of the step.
        out = step * jnp.square(before) / (2 * jnp.where(turns, before - velocity, 1.0))
        both = before + velocity
        goes_on = ~turns & (both != 0)
        half = way * jnp.where(goes_on, (3 * before + velocity) / (4 * jnp.where(goes_on, both, 1.0)), 0.5)
        bend = self._bend(memory, signals, jnp.where(turns, out, half), way, turns)
        return Bent(bend, signals.limit_over_rest, place, velocity)

    def value(self, memory: Bent, signals: Signals) -> Array:
        way = _motion(signals)[0] - memory.place
        return self._bend(memory, signals, way / 2, way) / signals.limit_over_rest

    def _bend(
        self, memory: Bent, signals: Signals, first: Array, way: Array, turns: Array | bool = False
    ) -> Array:
        """Bend after a way of two parts; in between the limit is the mean, at rest where it `turns`."""
        between = jnp.where(turns, 1.0, (memory.ratio + signals.limit_over_rest) / 2)
        distance = jnp.where(self.distance > LEAST_DISTANCE, self.distance, LEAST_DISTANCE)
        bend = dahl_between_limits(memory.bend, first, distance, memory.ratio, between)
        return dahl_between_limits(bend, way - first, distance, between, signals.limit_over_rest)

    def deflection(self) -> Array:
        return self.distance

    def damping(self) -> Array:
        return self.damping_time


LEAST_DISTANCE = 1e-12
"""Way within which friction turns round when it has no bristles [m or rad]."""


def _motion(signals: Signals) -> tuple[Array, Array]:
    """Place and velocity of what rubs: of the load, or where there is none of the muscle's contraction."""
    if signals.position is None:
        return signals.contraction, signals.contraction_velocity
    return signals.position, signals.velocity
