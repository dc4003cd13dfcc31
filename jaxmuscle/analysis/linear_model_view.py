"""What a notebook shows of a linear model."""

from __future__ import annotations

import math

import numpy as np

from jaxmuscle.analysis.state_space import RESTING, StateSpace, frequencies
from jaxmuscle.formatting import rounded, words
from jaxmuscle.notebook_html import Sparkline, Table, View


def linear_model_view(model: StateSpace) -> View:
    """Gains and magnitudes of every path, and the poles."""
    name = f"{len(model.states)} states"
    facts = [f"inputs: {', '.join(map(words, model.inputs))}"]
    facts.append(f"outputs: {', '.join(map(words, model.outputs))}")
    if model.a.ndim != 2:
        batch = " × ".join(map(str, model.a.shape[:-2]))
        return View("linear models", f"{batch} at once", [name, *facts])
    a = model.a
    if not np.isfinite(a).all():
        return View("linear model", name, facts, badge="no point of rest", mood="doubt")
    omega = frequencies(a)
    slow = omega[:1] * 1e-3
    static, whole = model.response(slow)[0].real, np.abs(model.response(omega))
    paths = [
        (f"{words(u)} → {words(y)}", rounded(float(static[i, j]), 4), Sparkline(np.log10(whole[:, i, j])))
        for i, y in enumerate(model.outputs)
        for j, u in enumerate(model.inputs)
        if whole[:, i, j].all()
    ]
    poles = sorted(np.linalg.eigvals(a), key=abs)
    magnitude = f"magnitude, {rounded(omega[0])} to {rounded(omega[-1])} rad/s, logarithmic"
    return View(
        "linear model",
        name,
        facts,
        tables=[
            Table("paths (SI)", ("", "gain at low frequency", magnitude), paths),
            Table("poles", ("pole [rad/s]", "frequency [Hz]", "damping ratio"), [_pole(p) for p in poles]),
        ],
    )


def _pole(pole: complex) -> tuple[str, str, str]:
    size = abs(pole)
    damping = rounded(-pole.real / size, 3) if size > RESTING else ""
    imaginary = f" {'+' if pole.imag > 0 else '−'} {rounded(abs(pole.imag), 4)} j" if pole.imag else ""
    return f"{rounded(pole.real, 4)}{imaginary}", rounded(size / (2 * math.pi), 3), damping
