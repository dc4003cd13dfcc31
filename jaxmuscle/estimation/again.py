"""A fit that goes on from where another one ended."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from jaxmuscle.estimation import checked
from jaxmuscle.estimation.agreement import labels
from jaxmuscle.estimation.arguments import asked_for
from jaxmuscle.estimation.data import FitData
from jaxmuscle.estimation.layout import layout


def fitted_start(result: FitData, recordings: object, settings: Mapping[str, Any]) -> dict[str, float]:
    """The fitted values of everything that is free again, a recording's own ones by its name.

    Args:
        recordings, settings: what :func:`jaxmuscle.fit` is to be called with.

    Raises:
        InputError: the arguments cannot be used.
    """
    given = checked.given_recordings(result.actuator, recordings)
    asked = asked_for(*(settings[name] for name in ("free", "shared", "per_recording", "priors", "bounds")))
    names = layout(result.actuator, given, labels(given), asked).names
    return {name: value for name, value in result.values.items() if name in names}
