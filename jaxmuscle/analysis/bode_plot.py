"""Bode plot of a linear model."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import ArrayLike

from jaxmuscle.analysis.state_space import StateSpace, frequencies
from jaxmuscle.errors import InputError
from jaxmuscle.formatting import words

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SIZE = (5.2, 4.6)
"""Width and height of the two panels of one output [in]."""


DASHES = ("-", (0, (4, 3)), ":", "-.")
"""Of the curves of several inputs, which may lie over each other."""


def bode_plot(
    model: StateSpace, outputs: Sequence[str], inputs: Sequence[str], omega: ArrayLike | None = None
) -> Figure:
    """Magnitude [dB, of SI units] above phase [degrees], a column for each output, a curve for each input."""
    import matplotlib as mpl  # with the first figure, not with the classes

    from jaxmuscle.figure_style import STYLE, figure

    grid = frequencies(model.a) if omega is None else np.asarray(omega, dtype=float)
    if grid.ndim != 1 or len(grid) < 2 or not (np.isfinite(grid) & (grid > 0)).all():
        raise InputError("omega: expected at least two frequencies above zero [rad/s]")
    response = model.response(grid)
    with mpl.rc_context({**STYLE, "figure.facecolor": "white"}):
        drawing = figure(SIZE[1], SIZE[0] * len(outputs))
        panels: Any = drawing.subplots(2, len(outputs), sharex=True, squeeze=False)
        for column, output in enumerate(outputs):
            above, below = panels[:, column]
            for number, name in enumerate(inputs):
                values = response[:, model.outputs.index(output), model.inputs.index(name)]
                if not values.any():
                    continue  # this input does not act on this output
                look: dict[str, Any] = {"color": f"C{number}", "linestyle": DASHES[number % len(DASHES)]}
                above.semilogx(grid, 20 * np.log10(np.abs(values)), label=words(name), **look)
                below.semilogx(grid, np.rad2deg(np.unwrap(np.angle(values))), **look)
            above.set_title(f"{words(output)} from {', '.join(map(words, inputs))}")
            above.set_ylabel("magnitude [dB]")
            below.set_ylabel("phase [°]")
            below.set_xlabel("frequency [rad/s]")
            if len(inputs) > 1:
                above.legend()
    return drawing
