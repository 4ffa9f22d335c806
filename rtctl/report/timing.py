"""How the loop kept time: wake-up lateness and the time of a tick."""

import numpy as np
from matplotlib.figure import Figure

from rtctl.report.style import BLUE, INK, ORANGE, picture
from rtctl.summary import Run

CAPTION = (
    "All ticks of the run, on logarithmic axes. Lateness: from the grid point to the wake-up of the loop. "
    "Tick: from the wake-up to the end of the record, devices included."
)
BINS = 70
SHORTEST_US = 0.5
LABEL = {"facecolor": "white", "alpha": 0.75, "edgecolor": "none", "pad": 0.6}


def draw(run: Run) -> Figure | None:
    """The picture, or None in lockstep, where no time is measured."""
    if not run.records["tick_ns"].any():
        return None

    def on(figure: Figure) -> None:
        panels = figure.subplots(2, 1)
        period_us = 1e6 * run.period_s
        for axes, name, title, colour in zip(
            panels, ("lateness_ns", "tick_ns"), ("lateness", "tick"), (ORANGE, BLUE), strict=True
        ):
            times_us = np.maximum(run.records[name] * 1e-3, SHORTEST_US)
            edges = np.geomspace(0.5 * times_us.min(), max(2 * period_us, 1.05 * times_us.max()), BINS + 1)
            axes.hist(times_us, edges, color=colour, alpha=0.85)
            axes.set_xscale("log")
            axes.set_yscale("log")
            axes.set_ylim(bottom=0.6)
            for share in (50, 99, 99.9):
                at = np.percentile(times_us, share)
                axes.axvline(at, color=INK, linewidth=0.9, linestyle=":")
                axes.text(
                    at, 0.97, f" p{share:g} {at:.3g} µs", fontsize=7.5, rotation=90, ha="right", va="top",
                    transform=axes.get_xaxis_transform(), bbox=LABEL,
                )  # fmt: skip
            axes.axvline(period_us, color=INK, linewidth=1.0)
            axes.set_xlabel(f"{title} [µs]; full line: one period")
            axes.set_ylabel("ticks")

    return picture(on, 4.6)
