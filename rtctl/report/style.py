"""One look for all pictures of a report, drawn without a display and the same on every machine."""

import io
from collections.abc import Callable
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure

from hal.errors import RtctlError

BLUE, ORANGE, GREEN, RED, VIOLET = "#1b5fa6", "#d9740f", "#2a8a57", "#c0392b", "#7a4fa3"
INK, GREY, FAINT, BAND = "#22303c", "#7b8794", "#d6dce2", "#e9eef4"
WIDTH_IN = 5.4
"""On a telephone a picture is shown about this wide, so its letters keep their size."""
DOTS_PER_INCH = 200
POINTS = 1500
"""A curve is drawn with about so many points."""

LOOK: Any = {
    "font.size": 9.5,
    "axes.titlesize": 10,
    "axes.labelsize": 9.5,
    "axes.edgecolor": GREY,
    "axes.labelcolor": INK,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": "#e6eaee",
    "grid.linewidth": 0.8,
    "text.color": INK,
    "xtick.color": GREY,
    "ytick.color": GREY,
    "xtick.labelcolor": INK,
    "ytick.labelcolor": INK,
    "lines.linewidth": 1.6,
    "legend.fontsize": 8.5,
    "legend.frameon": False,
    "figure.facecolor": "white",
    "svg.hashsalt": "rtctl",
    "svg.fonttype": "path",
}


def picture(draw: Callable[[Figure], None], height_in: float) -> Figure:
    """A figure in the common look, drawn on by `draw`."""
    with matplotlib.rc_context(LOOK):
        figure = Figure(figsize=(WIDTH_IN, height_in), layout="constrained")
        draw(figure)
    return figure


def svg(figure: Figure) -> str:
    """The figure as an <svg> element for a page."""
    buffer = io.StringIO()
    with matplotlib.rc_context(LOOK):
        FigureCanvasSVG(figure).print_svg(buffer, metadata={"Date": None, "Creator": None})
    text = buffer.getvalue()
    return text[text.index("<svg") :]


def save(figure: Figure, path: Path) -> None:
    """Write the figure to a file, .svg or .png.

    Raises:
        RtctlError: another suffix, or the file cannot be written.
    """
    try:
        if path.suffix == ".svg":
            path.write_text('<?xml version="1.0" encoding="utf-8"?>\n' + svg(figure), encoding="utf-8")
        elif path.suffix == ".png":
            figure.savefig(path, dpi=DOTS_PER_INCH, metadata={"Software": None})
        else:
            raise RtctlError("a picture is .svg or .png", value=str(path), remedy="give the file one of these endings")
    except OSError as error:
        raise RtctlError("the picture cannot be written", value=str(path), remedy=str(error.strerror)) from None


def thin(values: np.ndarray) -> slice:
    """Which of the `values` to draw."""
    return slice(None, None, max(1, len(values) // POINTS))


def legend_above(axes: Axes, columns: int) -> None:
    """The legend in rows above the plot, where it hides nothing."""
    axes.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=columns, borderaxespad=0.2, columnspacing=1.4)
