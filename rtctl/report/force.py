"""Force against depth, beside the forces of the reference study."""

import numpy as np
from matplotlib.figure import Figure

from rtctl.guidance.force_model import FULL_DEPTH_MM, resistance
from rtctl.report.style import BAND, BLUE, GREY, INK, ORANGE, legend_above, picture, thin
from rtctl.summary import INSERTION_SHARE, Run

CAPTION = (
    "Resistance along the insertion axis and force across it, filtered and free of bias and gravity. "
    "Band: mean and standard deviation of the reference insertions (dissertation, Table V.2), which end at 13.8 mm. "
    "Mean and peak of the summary count up to 95 % of the inserted depth."
)


def draw(run: Run) -> Figure | None:
    """The picture, or None if nothing was inserted."""
    rows = run.inserting
    if len(rows) < 2:
        return None
    rows = rows[thin(rows)]

    def on(figure: Figure) -> None:
        axes = figure.add_subplot()
        depth = np.linspace(0.0, FULL_DEPTH_MM, 200)
        mean, deviation = 1e3 * np.array(resistance(depth))
        axes.fill_between(depth, mean - deviation, mean + deviation, color=BAND, label="Table V.2, mean ± SD")
        axes.plot(depth, mean, color=GREY, linewidth=1.0, linestyle=(0, (4, 3)))
        axes.plot(rows["depth_mm"], 1e3 * rows["force_lateral_n"], color=ORANGE, linewidth=1.2, label="lateral")
        axes.plot(rows["depth_mm"], -1e3 * rows["force_axial_n"], color=BLUE, label="resistance")
        axes.axhline(0.0, color=GREY, linewidth=0.8)
        _mark(axes, INSERTION_SHARE * run.depth_mm, "95 %")
        _mark(axes, run.aos_depth_mm, "stylet starts")
        axes.set_xlim(0.0, max(run.depth_mm, FULL_DEPTH_MM) * 1.01)
        axes.set_xlabel("insertion depth [mm]")
        axes.set_ylabel("force [mN]")
        legend_above(axes, 3)

    return picture(on, 3.5)


def _mark(axes, depth_mm: float, text: str) -> None:
    if np.isfinite(depth_mm):
        axes.axvline(depth_mm, color=GREY, linewidth=0.9, linestyle=":")
        axes.text(
            depth_mm, 0.98, f"{text} ", rotation=90, fontsize=7.5, color=INK, ha="right", va="top",
            transform=axes.get_xaxis_transform(),
        )  # fmt: skip
