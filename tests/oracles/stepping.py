"""One classical Runge-Kutta step of a state held in a list: small systems are faster in plain floats."""


def runge_kutta(rates, state, h, *held):
    """The state after h seconds; `held` goes to `rates` unchanged."""
    k1 = rates(state, *held)
    k2 = rates([s + h / 2 * k for s, k in zip(state, k1, strict=True)], *held)
    k3 = rates([s + h / 2 * k for s, k in zip(state, k2, strict=True)], *held)
    k4 = rates([s + h * k for s, k in zip(state, k3, strict=True)], *held)
    slopes = zip(state, k1, k2, k3, k4, strict=True)
    return [s + h / 6 * (a + 2 * b + 2 * c + d) for s, a, b, c, d in slopes]
