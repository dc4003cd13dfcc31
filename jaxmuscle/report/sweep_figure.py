"""A picture of a sweep: a map over two quantities, curves over one, or runs over time."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path

import matplotlib as mpl
import numpy as np
import xarray as xr
from matplotlib.axes import Axes

from jaxmuscle.figure_style import AFTER, STYLE, figure
from jaxmuscle.files import atomic_write
from jaxmuscle.formatting import pretty, printed_unit
from jaxmuscle.sweeps.job import FAILED
from jaxmuscle.sweeps.outputs import TIME

MOST_CURVES = 9
COLOURS = "viridis"
PANEL = (4.6, 3.4)
"""Width and height of a panel [in]."""

Written = Mapping[str, tuple[str, Callable[[np.ndarray], np.ndarray]]]
"""Coordinate → its unit in the picture, and the function that brings SI to it."""


def draw_sweep(sweep: xr.Dataset, written: Written, file: Path) -> None:
    """Draw every variable of `sweep` into `file` (png, svg, pdf).

    Args:
        written: units of the coordinates; SI for those that are not named. Variables get a unit of the
            size of their values.
    """
    names = [str(name) for name in sweep.data_vars if name != FAILED]
    across = 2 if len(names) > 1 else 1
    down = -(-len(names) // across)
    with mpl.rc_context({**STYLE, "figure.facecolor": "white"}):
        drawing = figure(PANEL[1] * down, PANEL[0] * across)
        panels = np.ravel(drawing.subplots(down, across))
        for panel, name in zip(panels, names, strict=False):
            _draw(panel, sweep[name], written)
        for panel in panels[len(names) :]:
            panel.set_axis_off()
        with atomic_write(file) as (unfinished,):
            drawing.savefig(unfinished, dpi=130)


def _draw(axes: Axes, values: xr.DataArray, written: Written) -> None:
    finite = values.values[np.isfinite(values.values)]
    size, unit = printed_unit(values.attrs["units"], float(np.abs(finite).max()) if len(finite) else 1.0)
    absolute = " absolute" if values.attrs.get("reference") == "absolute" else ""
    label = str(values.name).replace("_", " ") + (f" [{unit}{absolute}]" if unit else "")
    dims = [str(dim) for dim in values.dims if values.sizes[dim] > 1]
    along = TIME if TIME in dims else dims[0] if dims else str(values.dims[0])
    others = [dim for dim in dims if dim != along]
    if TIME in dims or len(others) != 1:
        _curves(axes, values / size, along, others, written, label)
    else:
        _map(axes, values / size, along, others[0], written, label)


def _map(axes: Axes, values: xr.DataArray, x: str, y: str, written: Written, label: str) -> None:
    grid = values.squeeze().transpose(y, x).values
    right, up = _scaled(values, x, written)[0], _scaled(values, y, written)[0]
    mesh = axes.pcolormesh(cell_edges(right), cell_edges(up), np.ma.masked_invalid(grid), cmap=COLOURS)
    axes.figure.colorbar(mesh, ax=axes)
    axes.grid(visible=False)
    axes.set_facecolor("#e8ebef")
    _label(axes, "x", right, _scaled(values, x, written)[1])
    _label(axes, "y", up, _scaled(values, y, written)[1])
    axes.set_title(label)


def _curves(
    axes: Axes, values: xr.DataArray, x: str, others: list[str], written: Written, label: str
) -> None:
    """Curves along `x`, of a few entries of the first of the others; the rest at their middle."""
    first = others[0] if others else None
    fixed = {dim: values.sizes[dim] // 2 for dim in others[1:]}
    shown = values.isel(fixed).squeeze()
    right, name = _scaled(values, x, written)
    count = values.sizes[first] if first else 1
    rows = np.unique(np.linspace(0, count - 1, min(count, MOST_CURVES)).astype(int))
    colours = mpl.colormaps[COLOURS](np.linspace(0, 0.9, len(rows)))
    for row, colour in zip(rows, colours, strict=True):
        curve = shown.isel({first: row}) if first else shown
        text = _entry(values, first, row, written) if first else None
        axes.plot(right, np.atleast_1d(curve.values), color=colour if first else AFTER, label=text, lw=1.4)
    if first:
        axes.legend(title=first, fontsize=7.5, title_fontsize=8)
    _label(axes, "x", right, name)
    at = ", ".join(f"{dim} = {_entry(values, dim, row, written)}" for dim, row in fixed.items())
    axes.set_title(label + (f" at {at}" if at else ""))


def _scaled(values: xr.DataArray, dim: str, written: Written) -> tuple[np.ndarray, str]:
    """The coordinate of a dimension as it is shown, and its label."""
    if dim not in values.coords:
        return np.arange(values.sizes[dim]), dim
    coordinate = values[dim]
    unit, convert = written.get(dim, (coordinate.attrs.get("units", ""), np.asarray))
    return convert(coordinate.values), dim + (f" [{pretty(unit)}]" if unit else "")


def _entry(values: xr.DataArray, dim: str, row: int, written: Written) -> str:
    numbers, label = _scaled(values, dim, written)
    unit = label.partition("[")[2].rstrip("]")
    return f"{numbers[row]:.3g} {unit}".strip()


def _label(axes: Axes, which: str, numbers: np.ndarray, text: str) -> None:
    """Name an axis; logarithmic where the values are spaced so."""
    axes.set(**{f"{which}label": text})
    if _geometric(numbers):
        axes.set(**{f"{which}scale": "log"})


def _geometric(numbers: np.ndarray) -> bool:
    """Whether values are spaced by a factor, and not evenly."""
    if len(numbers) <= 2 or not (numbers > 0).all():
        return False
    ratios, steps = np.diff(np.log(numbers)), np.diff(numbers)
    alike = [np.ptp(values) <= 1e-6 * abs(values).max() for values in (ratios, steps)]
    return alike == [True, False]


def cell_edges(numbers: np.ndarray) -> np.ndarray:
    """Edges of cells about values: halfway between neighbours, on a logarithmic axis by their logarithms."""
    if _geometric(numbers):
        return np.exp(cell_edges(np.log(numbers)))
    half = np.diff(numbers) / 2 if len(numbers) > 1 else np.array([0.5])
    return np.concatenate(
        [numbers[:1] - half[:1], numbers[:-1] + half[: len(numbers) - 1], numbers[-1:] + half[-1:]]
    )
