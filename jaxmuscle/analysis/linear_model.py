"""Linear models (poles, zeros, frequency response, bandwidth) and linearisation about an operating point by
automatic differentiation.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import equinox as eqx
import jax
import jax.core
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Bool, Complex, Float
from numpy.typing import NDArray
from scipy.linalg import eigvals

from jaxmuscle._linalg import solve
from jaxmuscle.actuators.actuator import AbstractActuator
from jaxmuscle.analysis.bode_plot import bode_plot
from jaxmuscle.analysis.linear_model_view import linear_model_view
from jaxmuscle.analysis.operating_point import OperatingPoint
from jaxmuscle.analysis.state_space import StateSpace
from jaxmuscle.errors import InputError

if TYPE_CHECKING:
    from matplotlib.figure import Figure

LOWEST, HIGHEST, GRID = 1e-3, 1e5, 400
"""Range [rad/s] in which a bandwidth is looked for, and points on its logarithmic grid."""
HALF_POWER = 0.5**0.5
FAR = 1e7
"""Zeros farther than this from the origin [rad/s] are taken to be at infinity."""


class LinearModel(eqx.Module):
    r""":math:`\dot x = A x + B u,\ y = C x + D u` about an operating point.

    `states`, `inputs` and `outputs` name the entries of x, u and y. `converged`: whether there is such a
    point; where there is none, among many at once, all numbers are NaN.
    """

    a: Float[Array, "states states"]
    b: Float[Array, "states inputs"]
    c: Float[Array, "outputs states"]
    d: Float[Array, "outputs inputs"]
    states: tuple[str, ...] = eqx.field(static=True)
    inputs: tuple[str, ...] = eqx.field(static=True)
    outputs: tuple[str, ...] = eqx.field(static=True)
    converged: Bool[Array, ""] | bool = True

    @eqx.filter_jit
    def poles(self) -> Complex[Array, " states"]:
        """Eigenvalues of A [rad/s], by increasing magnitude."""
        values = jnp.linalg.eigvals(self.a)
        return values[jnp.argsort(jnp.abs(values))]

    def zeros(self, output: str, input: str | None = None) -> NDArray[np.complex128]:
        """Transmission zeros from one input to one output [rad/s], by increasing magnitude.

        Finite eigenvalues of the system matrix (Rosenbrock 1970); computed outside JAX.
        """
        i, j = self._places(output, input)
        size = len(self.states)
        scale = np.asarray(jnp.abs(self.a)).max(axis=1) + 1e-300
        # Rows scaled to one: pressures and tip positions differ by nine orders of magnitude.
        top = np.hstack([np.asarray(self.a), np.asarray(self.b)[:, [j]]]) / scale[:, None]
        bottom = np.append(np.asarray(self.c)[i], np.asarray(self.d)[i, j])[None]
        left = np.vstack([top, bottom / np.abs(bottom).max()])
        right = np.zeros((size + 1, size + 1))
        right[:size, :size] = np.diag(1 / scale)
        found = np.asarray(eigvals(left, right))
        found = found[np.isfinite(found) & (np.abs(found) < FAR)]
        return found[np.argsort(np.abs(found))]

    @eqx.filter_jit
    def response(self, omega: Array, output: str, input: str | None = None) -> Complex[Array, "..."]:
        """Frequency response G(jω) from one input to one output; ω in rad/s, any shape."""
        i, j = self._places(output, input)

        def at(w: Array) -> Array:
            matrix = 1j * w * jnp.eye(len(self.states)) - self.a
            return self.c[i] @ solve(matrix, self.b[:, j].astype(complex)) + self.d[i, j]

        return jnp.vectorize(at)(jnp.asarray(omega, dtype=float))

    def gain(self, output: str, input: str | None = None) -> Float[Array, ""]:
        """Static gain from one input to one output."""
        return self.response(jnp.asarray(0.0), output, input).real

    @eqx.filter_jit
    def bandwidth(self, output: str, input: str | None = None) -> Float[Array, ""]:
        """Lowest frequency [rad/s] at which the gain has fallen by 3 dB from the static one.

        Infinite where it has not within 10^5 rad/s, NaN where the gain is. May be vmapped.
        """
        limit = HALF_POWER * jnp.abs(self.gain(output, input))
        grid = jnp.logspace(np.log10(LOWEST), np.log10(HIGHEST), GRID)
        below = jnp.abs(self.response(grid, output, input)) < limit
        first = jnp.maximum(jnp.argmax(below), 1)

        def halved(bracket: tuple[Array, Array], _: None) -> tuple[tuple[Array, Array], None]:
            low, high = bracket
            middle = jnp.sqrt(low * high)
            fallen = jnp.abs(self.response(middle, output, input)) < limit
            return (jnp.where(fallen, low, middle), jnp.where(fallen, middle, high)), None

        (low, high), _ = jax.lax.scan(halved, (grid[first - 1], grid[first]), None, length=40)
        return jnp.where(below.any(), jnp.sqrt(low * high), jnp.where(jnp.isnan(limit), jnp.nan, jnp.inf))

    def bode(
        self, output: str | None = None, input: str | None = None, omega: ArrayLike | None = None
    ) -> Figure:
        """A matplotlib figure: magnitude [dB] and phase [degrees] over the frequency [rad/s].

        Args:
            output, input: one of each; all of them when not given.
            omega: frequencies [rad/s]; from a tenth of the slowest pole to ten times the fastest when not
                given.

        Raises:
            InputError: an unknown output or input, frequencies that are not positive, many models at once.
        """
        self._places(output or self.outputs[0], input or self.inputs[0])
        outputs = self.outputs if output is None else (output,)
        return bode_plot(single(self)._plain(), outputs, self.inputs if input is None else (input,), omega)

    def to_control(self) -> Any:
        """The same model as a ``control.StateSpace`` of python-control, with the names of x, u and y.

        Raises:
            InputError: python-control is not installed (the extra ``control``), many models at once.
        """
        model = single(self)
        try:
            import control
        except ImportError as error:
            raise InputError(
                "to_control: expected python-control; it is not installed: "
                "python -m pip install 'jaxmuscle[control]'"
            ) from error
        names = {"states": list(self.states), "inputs": list(self.inputs), "outputs": list(self.outputs)}
        return control.ss(*model._plain()[:4], **names)

    def _repr_html_(self) -> str:
        """What a notebook shows: gains, bandwidths and magnitudes, poles."""
        return linear_model_view(self._plain()).html()

    def _plain(self) -> StateSpace:
        a, b, c, d = (np.asarray(each) for each in (self.a, self.b, self.c, self.d))
        return StateSpace(a, b, c, d, self.states, self.inputs, self.outputs)

    def _places(self, output: str, input: str | None) -> tuple[int, int]:
        if output not in self.outputs:
            raise InputError(f"expected an output of {list(self.outputs)}; got {output!r}")
        if input is None and len(self.inputs) > 1:
            raise InputError(f"there are several inputs, {list(self.inputs)}; name one")
        chosen = next(iter(self.inputs)) if input is None else input
        if chosen not in self.inputs:
            raise InputError(f"expected an input of {list(self.inputs)}; got {chosen!r}")
        return self.outputs.index(output), self.inputs.index(chosen)


def single(model: LinearModel) -> LinearModel:
    """`model` when it is one, about a point that exists.

    Raises:
        InputError: many models at once, as under `jax.vmap`; a point that did not converge.
    """
    if model.a.ndim != 2:
        raise InputError(
            f"expected one model; got many at once, A of shape {model.a.shape}: take one with "
            f"jax.tree.map(lambda x: x[0], models)"
        )
    if not bool(model.converged):
        raise InputError("expected a model about a point of rest; there was none (model.converged is false)")
    return model


def linearise(actuator: AbstractActuator, point: OperatingPoint) -> LinearModel:
    """A, B, C, D of `actuator` about `point`: exact derivatives of its vector field and readings.

    For the jet-pipe actuator what [H] 4.3 to 4.33 derive by hand.

    Inputs are the rig's commands, outputs its readings. States that the point holds stay held; effects with
    a memory are taken with the branch they are on, so that inside a play the part behind it does not move;
    a delay counts for nothing; at a stop a state goes back to it with rate 1/τ, whatever the command
    (:meth:`Situation.rates`). May be vmapped together with :func:`equilibrium`: inside a transformation the
    model of a point that did not converge is NaN throughout, and its `converged` is false.

    Raises:
        InputError: the point did not converge, called outside of transformations.
    """
    if not isinstance(point.converged, jax.core.Tracer) and not bool(jnp.all(point.converged)):
        raise InputError(
            f"linearise: expected a machine at rest; rig {actuator.rig!r} comes to no rest under command "
            f"{point.command} from the states it was started from (point.converged is false). Give "
            "equilibrium another start, hold what rests at any value (the pressure behind a shut valve: "
            'hold=("pressure",)), or ask for an output within reach'
        )
    return _linearised(actuator, point)


@eqx.filter_jit
def _linearised(actuator: AbstractActuator, point: OperatingPoint) -> LinearModel:
    """:func:`linearise`, compiled once for every kind of machine."""
    here = point.situation
    states = point.state.size

    def everything(both: Array) -> Array:
        x, u = both[:states], both[states:].reshape(point.command.shape)
        return jnp.concatenate([here.rates(actuator, x, u), here.readings(actuator, x, u)])

    slopes = jax.jacfwd(everything)(jnp.concatenate([point.state, point.command.ravel()]))
    slopes = jnp.where(point.converged, slopes, jnp.nan)
    return LinearModel(
        a=slopes[:states, :states],
        b=slopes[:states, states:],
        c=slopes[states:, :states],
        d=slopes[states:, states:],
        states=here.names,
        inputs=actuator.commands,
        outputs=tuple(name for names in actuator.outputs.values() for name in names),
        converged=point.converged,
    )
