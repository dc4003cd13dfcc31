"""A run as moving pictures, and the picture of a rig with its parameters."""

from __future__ import annotations

import base64
import dataclasses
import html
import io
import math
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from numpy.typing import NDArray
from PIL import Image

from jaxmuscle.actuators.actuator import AbstractActuator
from jaxmuscle.animation.drawn_parts import text
from jaxmuscle.animation.run_columns import (
    Columns,
    columns_of,
    is_pressure,
    pressure_levels,
    unit_of,
    where_to_find,
)
from jaxmuscle.animation.scenes import Scene, scene
from jaxmuscle.errors import InputError
from jaxmuscle.figure_style import AFTER, INK, MUTED, STYLE, curve, figure
from jaxmuscle.files import atomic_folder, atomic_write
from jaxmuscle.formatting import printed_unit, words
from jaxmuscle.html_template import template
from jaxmuscle.notebook_html import parameter_rows
from jaxmuscle.recordings import Recording, actuator_from_card
from jaxmuscle.simulation.simulate import Simulation

FRAMES = 120
"""Most pictures of an animation, unless asked for: a longer run is shown faster, or in fewer of them."""
RATE = 25.0
"""Pictures a second."""
CURVES = 4
"""Curves beside the machine; more where a scene needs more columns."""
SIZE, DPI, COLOURS = (7.4, 4.8), 100, 96
"""Size of a picture [in], its resolution, and colours that are kept."""


@dataclasses.dataclass(frozen=True)
class Animation:
    """Moving pictures of a run; a notebook shows them with a slider.

    Attributes:
        times: instants of the pictures, on the clock of the run [s].
        speed: seconds of the run in a second of watching.
    """

    actuator: AbstractActuator
    scene: Scene
    clock: NDArray[np.float64]
    columns: Columns
    times: NDArray[np.float64]
    speed: float

    def picture(self, time: float) -> Figure:
        """A matplotlib figure of one instant [s]."""
        drawing, machine, cursors = self._stage()
        self._show(machine, cursors, time)
        return drawing

    def images(self) -> Iterator[Image.Image]:
        """All pictures, one after the other."""
        drawing, machine, cursors = self._stage()
        canvas = FigureCanvasAgg(drawing)
        # Curves and their axes are drawn once; what moves is drawn over them.
        for artist in (machine, *cursors):
            artist.set_animated(True)
        canvas.draw()
        still = canvas.copy_from_bbox(drawing.bbox)  # pyright: ignore[reportAttributeAccessIssue]
        for time in self.times:
            self._show(machine, cursors, float(time))
            canvas.restore_region(still)  # pyright: ignore[reportAttributeAccessIssue]
            for artist in (machine, *cursors):
                artist.draw(canvas.get_renderer())
            whole = Image.fromarray(np.asarray(canvas.buffer_rgba())).convert("RGB")
            yield whole.quantize(COLOURS)

    def save(self, path: str | Path) -> Path:
        """Write a page with a slider (``.html``), a moving picture (``.gif``), or PNG files into a folder.

        Raises:
            InputError: another ending, or what cannot be written.
        """
        place = Path(path)
        ending = place.suffix.lower()
        if ending == "":
            return self._save_folder(place)
        if ending not in (".html", ".gif"):
            raise InputError(
                f"{place}: expected a name that ends in .html or .gif, or a folder for PNG files"
            )
        with atomic_write(place) as (unfinished,):
            if ending == ".html":
                unfinished.write_text(self.to_html(), encoding="utf-8", newline="\n")
            else:
                first, *others = self.images()
                look: dict[str, Any] = {"save_all": True, "duration": self._pause, "loop": 0}
                first.save(unfinished, "GIF", append_images=others, **look)
        return place

    def to_html(self) -> str:
        """A page that plays the pictures; it needs nothing else."""
        frames = [base64.b64encode(_png(image)).decode("ascii") for image in self.images()]
        return template("player.html.j2", "jaxmuscle.animation").render(
            frames=frames,
            times=self.times.tolist(),
            pause=self._pause,
            title=f"{self.actuator.rig}, {self.speed:g} times as fast",
            width=int(SIZE[0] * DPI),
        )

    def _repr_html_(self) -> str:
        """What a notebook shows: the page in a frame of its own."""
        page = html.escape(self.to_html(), quote=True)
        width, height = (int(x * DPI) for x in SIZE)
        look = f'width="{width}" height="{height + 50}" style="border:0;max-width:100%"'
        return f'<iframe srcdoc="{page}" {look} title="{html.escape(self.actuator.rig)}"></iframe>'

    @property
    def _pause(self) -> int:
        """Milliseconds from picture to picture."""
        step = float(np.diff(self.times).mean()) if len(self.times) > 1 else 1.0
        return max(round(1000 * step / self.speed), 20)

    def _save_folder(self, folder: Path) -> Path:
        names = (f"{number:04d}.png" for number in range(len(self.times)))
        with atomic_folder(folder, names) as unfinished:
            for file, image in zip(unfinished, self.images(), strict=True):
                file.write_bytes(_png(image))
        return folder

    def _stage(self) -> tuple[Figure, Axes, list[Any]]:
        """A figure with place for the machine and the curves of the run, and lines that mark the instant."""
        with mpl.rc_context({**STYLE, "figure.facecolor": "white"}):
            drawing = Figure(figsize=SIZE, dpi=DPI)
            shown = _order(self.scene, self.columns)[: max(CURVES, 1 + len(self.scene.needed))]
            grid = drawing.add_gridspec(
                len(shown), 2, width_ratios=(1.45, 1), left=0.02, right=0.985, top=0.93, bottom=0.1,
                wspace=0.3, hspace=0.45 if len(shown) <= CURVES else 0.75,
            )  # fmt: skip
            machine = drawing.add_subplot(grid[:, 0])
            cursors = []
            for row, name in enumerate(shown):
                axes = drawing.add_subplot(grid[row, 1])
                size, unit = _printed(self.actuator, name, self.columns[name])
                curve(axes, self.clock, self.columns[name] / size, 600, color=INK, lw=1.0)
                title = self.scene.titles.get(name, words(name))
                axes.set_title(f"{title} [{unit}]" if unit else title, fontsize=9)
                axes.tick_params(labelsize=7.5, labelbottom=row == len(shown) - 1)
                axes.margins(x=0)
                axes.set_xlabel("time [s]" if row == len(shown) - 1 else "", fontsize=8.5)
                cursors.append(axes.axvline(self.clock[0], color=AFTER, linewidth=1.4))
        return drawing, machine, cursors

    def _show(self, machine: Axes, cursors: Sequence[Any], time: float) -> None:
        now = {name: float(np.interp(time, self.clock, values)) for name, values in self.columns.items()}
        with mpl.rc_context(STYLE):
            _draw_scene(machine, self.scene, now, pressure_levels(self.actuator, self.columns, now))
            text(machine, 0.02, 0.97, f"{time:.2f} s", transform=machine.transAxes, ha="left", color=MUTED)
        for cursor in cursors:
            cursor.set_xdata([time, time])


def animate(
    run: Recording | Simulation, actuator: AbstractActuator | None = None, *,
    speed: float = 1.0, frames: int | None = None,
) -> Animation:  # fmt: skip
    """Show a run in moving pictures: valve, bladder and braid, load or joint.

    Muscles are drawn at the length and radius that their contraction gives them (braid of constant thread
    length, [T] equation 3), the colour of the bladder is its pressure. What the rig has no dimensions of
    (the arm of a joint, the elbow) is a sketch. The jet pipe needs states that no sensor shows, which a
    simulation keeps: ``animate(simulate(actuator, recording, states=True), actuator)``.

    Args:
        run: a recording, or a simulation.
        actuator: the machine; of a recording that of its card when not given.
        speed: seconds of the run in a second of watching.
        frames: how many pictures; 25 a second, and 120 at most, when not given.

    Raises:
        InputError: a run of another kind or of another rig, a rig of which nothing is said how it looks, a
            speed or number that cannot be.
    """
    if not isinstance(run, Recording | Simulation):
        raise InputError(f"animate: expected a recording or a simulation; got {type(run).__name__}")
    if actuator is None:
        if not isinstance(run, Recording):
            raise InputError(
                "animate: a simulation does not hold its machine; give it: animate(run, actuator)"
            )
        actuator = actuator_from_card(run.card)
    if not 0 < speed < math.inf:
        raise InputError(f"speed: expected a number above zero; got {speed!r}")
    if frames is not None and (isinstance(frames, bool) or not isinstance(frames, int) or frames < 2):
        raise InputError(f"frames: expected a whole number from 2; got {frames!r}")
    seen = scene(actuator)
    clock, columns = columns_of(run, actuator)
    missing = [name for name in (seen.motion, *seen.needed) if name not in columns]
    if missing:
        raise InputError(
            f"animate: the run has no {', '.join(missing)}, which rig {actuator.rig!r} needs; it has "
            f"{', '.join(columns)}. {where_to_find(missing, actuator)}"
        )
    span = float(clock[-1] - clock[0])
    count = frames or min(max(int(RATE * span / speed), 2), FRAMES)
    return Animation(actuator, seen, clock, columns, np.linspace(clock[0], clock[-1], count), speed)


def draw(actuator: AbstractActuator) -> Figure:
    """A matplotlib figure of a rig at rest: its parts with their dimensions, and all its parameters.

    Raises:
        InputError: nothing is said of how this rig looks.
    """
    seen = scene(actuator)
    rows = [(name, value) for name, value, _ in parameter_rows(actuator).values()]
    with mpl.rc_context({**STYLE, "figure.facecolor": "white"}):
        drawing = figure(max(SIZE[1], 0.19 * len(rows) + 0.6), 9.4)
        machine, listed = drawing.subplots(1, 2, width_ratios=(1.5, 1))
        _draw_scene(machine, seen, seen.rest, pressure_levels(actuator, {}, seen.rest))
        for x, y, label in seen.labels:
            text(machine, x, y, label, color=INK)
        listed.set_axis_off()
        for number, (name, value) in enumerate(rows):
            y = 1 - (number + 0.5) / max(len(rows), 18)
            text(listed, 0.0, y, name, transform=listed.transAxes, ha="left", color=MUTED)
            text(listed, 1.0, y, value, transform=listed.transAxes, ha="right", color=INK)
        drawing.suptitle(f"rig {actuator.rig}", x=0.02, ha="left", fontsize=11)
    return drawing


def _draw_scene(axes: Axes, seen: Scene, now: Mapping[str, float], levels: Mapping[str, float]) -> None:
    axes.clear()
    axes.set_axis_off()
    axes.set_aspect("equal")
    axes.set(xlim=seen.limits[0], ylim=seen.limits[1])
    seen.draw(axes, now, levels)


def _order(seen: Scene, columns: Columns) -> list[str]:
    """What moves first, then the pressures, then the rest."""
    first = [seen.motion, *seen.needed]
    return [*first, *(name for name in columns if name not in first)]


def _printed(actuator: AbstractActuator, name: str, values: NDArray[np.float64]) -> tuple[float, str]:
    unit = unit_of(actuator, name)
    size, printed = printed_unit(unit, float(np.abs(values).max()))
    return size, f"{printed} absolute" if is_pressure(actuator, name) else printed


def _png(image: Image.Image) -> bytes:
    buffer = io.BytesIO()
    image.save(buffer, "PNG")
    return buffer.getvalue()
