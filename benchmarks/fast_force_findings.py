"""What the measured muscles have in common, and what that says of where the force gets late."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import fast_force_models as models
import numpy as np
from psu_isometric import Series
from scipy.optimize import minimize_scalar
from scipy.stats import linregress

EXPLANATIONS = ("before", "lag", "delay", "line")
RINGING = ("measured", "lag", "delay", "line", "lossless")
"""The fit of the line takes its loss from the strong flow of a pulse; in the ringing little flows."""
SOUND = 343.0

Row = dict[str, Any]


def findings(rows: list[Row]) -> Row:
    """Numbers over all recordings of the later rig, the trends being over the muscle's volume."""
    late, early = ([r for r in rows if r["rig"] == rig] for rig in ("later", "earlier"))
    rms = {name: np.array([r["rms"][name] for r in late]) for name in EXPLANATIONS}
    volumes = [r["volume"] for r in late]
    transit, filling = (np.array([r["line"][name] for r in late]) for name in ("transit", "filling"))
    both = [r for r in late if len(r["by_direction"]) == 2]
    later = [
        r["by_direction"]["venting"]["delay"][0] - r["by_direction"]["filling"]["delay"][0] for r in both
    ]
    directions = {n: [r["by_direction"][n]["line"] for r in both] for n in ("filling", "venting")}
    behind = {n: np.array([r["behind"][n] - r["behind"]["measured"] for r in late]) for n in RINGING[1:]}
    size = {n: np.log([r["size"][n] / r["size"]["measured"] for r in late]) for n in RINGING[1:]}
    length = 1e-3 * SOUND * float(transit.mean())
    # The volumes of line and muscle are as the transit and the filling time; the slope is per 10 cm³.
    holds = 1e-5 * float(transit.mean()) / _trend(volumes, filling)["slope"][0]
    return {
        "recordings": len(late),
        "rms": {name: float(np.median(values)) for name, values in rms.items()},
        "settled": float(np.median([r["settled"] for r in late])),
        "explained": {n: float(np.median(1 - (rms[n] / rms["before"]) ** 2)) for n in EXPLANATIONS[1:]},
        "delay_beats_lag": int(np.sum(rms["delay"] < rms["lag"])),
        "line_beats_both": int(np.sum(rms["line"] < np.minimum(rms["delay"], rms["lag"]))),
        "delay": _trend(volumes, [r["delay"][0] for r in late]),
        "transit": _trend(volumes, transit),
        "filling": _trend(volumes, filling),
        "line_length": length,
        "bore": 1e3 * float(np.sqrt(4 * holds / (np.pi * length))),
        "venting_later": _trend([r["volume"] for r in both], later),
        "line_by_direction": {name: float(np.median(values)) for name, values in directions.items()},
        "ring": _trend(volumes, [r["ring"] for r in late]),
        "ring_said": resonances(transit, filling, np.array([r["ring"] for r in late])),
        "behind_missed": {name: float(np.sqrt(np.mean(off**2))) for name, off in behind.items()},
        "size_missed": {name: float(np.exp(np.sqrt(np.mean(off**2)))) for name, off in size.items()},
        "earlier_delay": [r["delay"] for r in early],
    }


def resonances(transit: Series, filling: Series, rings: Series) -> Row:
    """How well the fitted lines say the ringing, with one closed volume at the gauge that suits them all.

    Times in ms. Returns that volume's filling time and the RMS error of the frequencies [Hz].
    """

    def missed(end: float) -> float:
        lines = zip(1e-3 * transit, 1e-3 * filling, strict=True)
        said = np.array([models.ring_frequency(line, 1e-3 * end) for line in lines])
        return float(np.sqrt(np.mean((said - rings) ** 2)))

    found: Any = minimize_scalar(missed, bounds=(0, 30), method="bounded")
    return {"gauge_end": float(found.x), "missed": float(found.fun)}


def _trend(volumes: Sequence[float], measured: Sequence[float] | Series) -> Row:
    """Scatter of values, and their straight line over the volume in units of 10 cm³."""
    values = np.asarray(measured)
    fit: Any = linregress(0.1 * np.asarray(volumes), values)
    return {
        "count": len(values),
        "mean": float(np.mean(values)),
        "spread": float(np.std(values, ddof=1)),
        "range": [float(np.min(values)), float(np.max(values))],
        "slope": [float(fit.slope), float(fit.stderr)],
        "at_zero": float(fit.intercept),
        "r": float(fit.rvalue),
    }


def conclusion(f: Row) -> list[str]:
    """The findings in words that follow the numbers."""
    delay, transit, filling, ring, venting = (
        f[n] for n in ("delay", "transit", "filling", "ring", "venting_later")
    )
    explained = ", ".join(f"{name} {share:.0%}" for name, share in f["explained"].items())
    early = [value for value, _ in f["earlier_delay"]]
    of, ways = f["recordings"], f["line_by_direction"]
    behind = ", ".join(f"{name} {off:.0f}°" for name, off in f["behind_missed"].items())
    size = ", ".join(f"{name} {off:.2f}" for name, off in f["size_missed"].items())
    return [
        f"Explained of the mean square on switches not fitted, median of {of} recordings: {explained}.",
        f"The delay beats the lag in {f['delay_beats_lag']}, the line beats both in {f['line_beats_both']}; "
        f"it leaves {f['rms']['line']:.1f} of {f['rms']['before']:.1f} N (settled: {f['settled']:.1f} N).",
        f"The delay, {_range(delay)} ms, {_depends(delay)} (r = {delay['r']:.3f}).",
        f"Venting is {venting['mean']:+.1f} ms later than filling ({venting['count']} recordings); "
        f"that {_depends(venting)}. The line, the same for both, leaves {ways['filling']:.1f} and "
        f"{ways['venting']:.1f} N.",
        f"Its transit time is {transit['mean']:.1f} ± {transit['spread']:.1f} ms, "
        f"{f['line_length']:.1f} m of air, and {_depends(transit)};",
        f"its filling time, {_range(filling)} ms, {_depends(filling)} (r = {filling['r']:.3f}), "
        f"as from a bore of {f['bore']:.1f} mm.",
        f"The ringing, {_range(ring)} Hz, {_depends(ring, 'Hz')}; the lines, closed by one volume at the "
        f"gauge, say it to {f['ring_said']['missed']:.1f} Hz.",
        f"How far the force is behind in it is missed by {behind}; its size by factors of {size}.",
        f"On the earlier rig, with the same calibration of the load cell, the delay is "
        f"{min(early):.2f} to {max(early):.2f} ms.",
        verdict(f),
    ]


def verdict(f: Row) -> str:
    """Whether all that an air line implies is there; the bounds are ours."""
    lossless, one = f["behind_missed"]["lossless"], (f["behind_missed"][n] for n in ("lag", "delay"))
    implied = {
        "it explains most in every recording": f["line_beats_both"] == f["recordings"],
        "its transit time scatters by less than 10 %": f["transit"]["spread"] < 0.1 * f["transit"]["mean"],
        "its filling time goes with the muscle's volume": f["filling"]["r"] > 0.9,
        "its ringing, lossless, has the measured phase within 15°": lossless < min(15.0, *one),
        "the earlier rig's delay is below 1 ms": max(abs(value) for value, _ in f["earlier_delay"]) < 1,
    }
    failed = [claim for claim, holds in implied.items() if not holds]
    if failed:
        return f"So an air line is not established; of what it implies this fails: {'; '.join(failed)}."
    return f"So it is the air between gauge and muscle, not the force sensor: {'; '.join(implied)}."


def _range(trend: Row) -> str:
    return f"{trend['range'][0]:.1f} to {trend['range'][1]:.1f}"


def _depends(trend: Row, unit: str = "ms") -> str:
    slope, error = trend["slope"]
    does = "depends" if abs(slope) > 3 * error else "does not depend"
    return f"{does} on the volume, {trend['at_zero']:.1f} {unit} {slope:+.2f} ± {error:.2f} per 10 cm³"
