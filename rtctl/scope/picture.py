"""A picture of captures: one plot for every unit, all captures over each other, the trigger at zero, gaps shaded."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from hal.signals import Signal
from rtctl.report.style import BAND, BLUE, GREEN, GREY, ORANGE, RED, VIOLET, legend_above, picture, save
from rtctl.scope.capture import Capture

COLOURS = (BLUE, ORANGE, GREEN, VIOLET, RED)
HEIGHT_IN = 2.0


def draw(captures: Sequence[Capture], path: str | Path) -> None:
    """Draw captures of one scope, at least one, to a file: .svg or .png.

    Raises:
        RtctlError: another ending, or it cannot be written.
    """
    groups: dict[str, list[Signal]] = {}
    for s in captures[0].signals:
        groups.setdefault(s.unit or s.name, []).append(s)

    def on(figure: Figure) -> None:
        for axes, (unit, signals) in zip(
            np.atleast_1d(figure.subplots(len(groups), sharex=True)), groups.items(), strict=True
        ):
            curves = [(s, k) for s in signals for k in (range(s.shape[0]) if s.shape else (None,))]
            for number, (s, k) in enumerate(curves):
                label = s.name if k is None else f"{s.name}[{k}]"
                for capture in captures:
                    values = capture[s.name] if k is None else capture[s.name][:, k]
                    colour = COLOURS[number % len(COLOURS)]
                    axes.plot(capture.time_s, values, color=colour, linewidth=1.1, label=label)
                    label = ""
            for capture in captures:
                time_s, gap = capture.time_s, np.flatnonzero(capture["missed"] + capture["lost"])
                for i in gap:
                    axes.axvspan(time_s[i - 1], time_s[i], color=BAND)
            axes.axvline(0.0, color=GREY, linewidth=0.9, linestyle=":")
            axes.set_ylabel(unit)
            legend_above(axes, 3)
        axes.set_xlabel("time since the trigger [s]")

    save(picture(on, 0.6 + HEIGHT_IN * len(groups)), Path(path))
