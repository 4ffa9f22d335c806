"""Pictures of a certificate: lateness and time of the tick as histograms, and every round beside its reference."""

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FormatStrFormatter, MaxNLocator

from rtctl.report.style import BLUE, GREY, INK, ORANGE, legend_above, picture

HEIGHT_IN = 3.0
SHOWN = ("p50", "p99", "p99.9")
LATENESS = "Wake-ups after their grid point, all rounds together; both axes logarithmic. The full line is one period."
TICK = (
    "From the wake-up to the end of the record, devices included; both axes logarithmic. The full line is one period."
)
ROUNDS = "Percentiles of the lateness in each round over those of cyclictest in the same round. At 1 the loop wakes up as a thread does that does nothing else."


def draw(document: Mapping[str, Any]) -> Iterator[tuple[str, str, Figure]]:
    """(title, caption, figure) of every picture there is something to show on."""
    period_us, reference = document["loop"]["period_us"], document["reference"].get("lateness")
    lateness = {"the loop": (document["lateness"], ORANGE)} | ({"cyclictest": (reference, GREY)} if reference else {})
    yield "Lateness", LATENESS, _histogram(lateness, period_us, "lateness [µs]")
    yield "Time of the tick", TICK, _histogram({"the loop": (document["tick"], BLUE)}, period_us, "tick [µs]")
    if reference:
        yield "Round by round", ROUNDS, _rounds(document["lateness"], reference)


def _histogram(series: Mapping[str, tuple[Mapping[str, Any], str]], period_us: float, label: str) -> Figure:
    def on(figure: Figure) -> None:
        axes: Axes = figure.subplots()
        for name, (times, colour) in series.items():
            found = times["histogram"]
            axes.stairs(found["counts"], found["edges_us"], color=colour, fill=len(series) == 1, linewidth=1.6, label=name)  # fmt: skip
        axes.set(xscale="log", yscale="log", xlabel=label, ylabel="how often")
        axes.set_ylim(bottom=0.6)
        axes.axvline(period_us, color=INK, linewidth=1.0)
        if len(series) > 1:
            legend_above(axes, len(series))

    return picture(on, HEIGHT_IN)


def _rounds(ours: Mapping[str, Any], theirs: Mapping[str, Any]) -> Figure:
    names = list(ours["percentiles_us"])
    ratios = np.array(ours["rounds_us"]) / np.array(theirs["rounds_us"])

    def on(figure: Figure) -> None:
        axes: Axes = figure.subplots()
        numbers = np.arange(1, len(ratios) + 1)
        for name, colour in zip(SHOWN, (BLUE, ORANGE, GREY), strict=True):
            axes.plot(numbers, ratios[:, names.index(name)], "o-", color=colour, markersize=4, label=name)
        axes.axhline(1.0, color=INK, linewidth=1.0)
        axes.set(xlabel="round", ylabel="loop over cyclictest")
        axes.set_yscale("log", base=2)
        axes.yaxis.set_major_formatter(FormatStrFormatter("%g"))
        axes.xaxis.set_major_locator(MaxNLocator(integer=True))
        legend_above(axes, len(SHOWN))

    return picture(on, HEIGHT_IN)
