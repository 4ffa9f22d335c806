"""Figures VI.4 to VI.6 of the admittance study: mean force over the insertion, and corrections at its end."""

import warnings

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from rtctl.guidance.force_model import resistance
from rtctl.report.style import BAND, BLUE, GREEN, GREY, ORANGE, RED, VIOLET, legend_above, picture
from rtctl.study.admittance import REGULATED_N, Case
from rtctl.study.insertions import COUNTED, FULL_DEPTH_MM, LAMBDA, Insertions

COLOURS = {"0": GREY, "0b": GREY, "1": BLUE, "2": GREEN, "3": ORANGE, "4": RED, "5": VIOLET}
STYLES = dict(zip(REGULATED_N, ("-", "--", ":"), strict=True))


def mean_forces(todo: list[Case], found: list[Insertions], specimen: str) -> Figure:
    """Mean resistance over the share of the insertion, of all sets of a specimen (Figs. VI.4, VI.5)."""

    def on(figure: Figure) -> None:
        axes = figure.add_subplot()
        if specimen == "phantom":
            mean, deviation = resistance(LAMBDA[COUNTED] * FULL_DEPTH_MM)
            edges = 1e3 * (mean - deviation), 1e3 * (mean + deviation)
            axes.fill_between(LAMBDA[COUNTED], *edges, color=BAND, label="Table V.2, one SD")
        for case, insertions in zip(todo, found, strict=True):
            if case.set.specimen == specimen:
                style = STYLES.get(case.regulated_n, "-")
                curve = 1e3 * _mean(insertions.axial_n[:, COUNTED])
                axes.plot(LAMBDA[COUNTED], curve, color=COLOURS[case.set.name], linestyle=style, label=case.name)
        axes.set_xlabel("share of the insertion, λ")
        axes.set_ylabel("resistance [mN]")
        legend_above(axes, 2)

    return picture(on, 4.2)


def corrections(todo: list[Case], found: list[Insertions]) -> Figure:
    """Correction of the path at the end, to the left of the insertion axis, insertion by insertion (Fig. VI.6)."""

    def on(figure: Figure) -> None:
        axes = figure.add_subplot()
        axes.axhspan(-2.0, 2.0, color=BAND, label="what the facial recess allows")
        start = 1
        for case, insertions in zip(todo, found, strict=True):
            if case.set.lateral_gain > 0:
                number = np.arange(start, start + len(insertions.each))
                start += len(number)
                _bars(axes, number, insertions, case)
        axes.set_xlabel("insertion")
        axes.set_ylabel("correction at the end [mm]")
        legend_above(axes, 2)

    return picture(on, 4.2)


def _bars(axes: Axes, number: np.ndarray, insertions: Insertions, case: Case) -> None:
    shade = 1.0 - 0.3 * max(REGULATED_N.index(case.regulated_n) if case.regulated_n in REGULATED_N else 0, 0)
    axes.bar(number, insertions.correction_mm, color=COLOURS[case.set.name], alpha=shade, label=case.name)


def _mean(curves: np.ndarray) -> np.ndarray:
    """Over the insertions that got so far; NaN where none did."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)
        return np.nanmean(curves, axis=0)
