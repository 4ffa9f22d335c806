"""Depth and stylet against time."""

import numpy as np
from matplotlib.figure import Figure

from rtctl.lifecycle import Task
from rtctl.report.style import BAND, BLUE, GREY, INK, ORANGE, legend_above, picture, thin
from rtctl.summary import Run

CAPTION = (
    "Commanded depth, and withdrawal of the stylet: planned (dashed) and measured. "
    "The plan couples the two; the stylet never goes back in. Shaded: holding."
)
MARGIN_S = 1.0


def draw(run: Run) -> Figure | None:
    """The picture, or None if nothing was inserted."""
    if len(run.inserting) < 2:
        return None
    time_s, records = run.recording.time_s, run.records
    inserting = np.flatnonzero(run.recording.insertion)
    start_s, end_s = time_s[inserting[0]], time_s[inserting[-1]]
    holding = np.isin(records["task_state"], (Task.HOLDING,)) & (time_s > start_s)
    last_s = time_s[holding][-1] if holding.any() else end_s
    shown = np.flatnonzero((time_s >= start_s - MARGIN_S) & (time_s <= last_s + MARGIN_S))
    shown = shown[thin(shown)]
    time, rows = time_s[shown] - start_s, records[shown]

    def on(figure: Figure) -> None:
        axes = figure.add_subplot()
        axes.fill_between(
            time, 0.0, 1.0, where=holding[shown], color=BAND, linewidth=0, transform=axes.get_xaxis_transform()
        )
        axes.plot(time, rows["depth_mm"], color=BLUE, label="depth")
        axes.plot(time, rows["stylet_measured_mm"], color=ORANGE, label="stylet, measured")
        axes.plot(
            time, rows["stylet_desired_mm"], color=INK, linewidth=1.0, linestyle=(0, (4, 3)), label="stylet, planned"
        )
        axes.axhline(run.goal_mm, color=GREY, linewidth=0.9, linestyle=":")
        axes.set_xlim(time[0], time[-1])
        axes.set_xlabel("time since the insertion began [s]")
        axes.set_ylabel("depth, withdrawal [mm]")
        legend_above(axes, 3)

    return picture(on, 3.3)
