"""Pictures of docs/explanation/plant.md: shapes through four insertions, force over depth, force by speed.

python -m studies.pictures              writes docs/pictures/plant-*.png, two minutes
"""

import sys
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from rtctl.guidance.force_model import FULL_DEPTH_MM, resistance
from rtctl.planner import plan_of
from rtctl.recording import Recording
from rtctl.report.cochlea_view import draw_truth, true_placement
from rtctl.report.style import BAND, BLUE, GREEN, GREY, ORANGE, RED, VIOLET, legend_above, picture
from rtctl.settings import load
from rtctl.simulation import simulate
from rtctl.study.insertions import AS_THE_SOURCES, LAMBDA, NO_CONTROL, WELL_REGISTERED
from studies.laboratory import Laboratory

FOLDER = Path(__file__).resolve().parent.parent / "docs" / "pictures"
BASE = (*WELL_REGISTERED, *AS_THE_SOURCES, *NO_CONTROL)
QUIET = (*BASE, "backend.options.trial.scatter=false")
FOUR = {
    "normal": [],
    "stylet 1 mm late": ["backend.options.array.stylet_offset_mm=-1.0"],
    "stylet 1.4 mm early": ["backend.options.array.stylet_offset_mm=1.4"],
    "entry 1.2 mm aside": ["backend.options.trial.lateral_mm=1.2"],
}
COLOURS = (BLUE, ORANGE, VIOLET, RED)
DEPTHS_MM = (3.0, 6.0, 9.0, 13.0)
SPEEDS = (0.5, 1.0, 2.0)
COUNT = 24
DOTS_PER_INCH = 160


def record(overrides: list[str]) -> Recording:
    """One insertion without scatter."""
    settings = load("planar-sim", [*QUIET, *overrides])
    return simulate(settings, 1, plan=plan_of(settings)).recording


def shapes(runs: dict[str, Recording]) -> Figure:
    """The true array at four depths of the four insertions."""

    def on(figure: Figure) -> None:
        panels = figure.subplots(len(runs), len(DEPTHS_MM))
        for line, (name, run) in zip(panels, runs.items(), strict=True):
            rows = run.records[run.insertion]
            place = true_placement(run.truths)
            assert place is not None
            assert run.truths is not None
            for axes, depth in zip(line, DEPTHS_MM, strict=True):
                last = min(int(np.searchsorted(rows["depth_mm"], depth)), len(rows) - 1)
                truth = run.truths[np.searchsorted(run.truths["tick"], rows["tick"][last])]
                _panel(axes, place.walls(), truth)
                if axes is line[0]:
                    axes.set_ylabel(name, fontsize=7.5)
                axes.set_title(f"{rows['depth_mm'][last]:.0f} mm", loc="left", fontsize=7.5)

    return picture(on, 5.0)


def _panel(axes: Axes, walls: tuple[np.ndarray, np.ndarray], truth: np.void) -> None:
    for wall in walls:
        axes.plot(*wall.T, color=GREY, linewidth=0.8)
    draw_truth(axes, truth, width=1.6)
    axes.set_aspect("equal")
    axes.set_xlim(162.0, 180.0)
    axes.set_ylim(-1.0, 12.0)
    axes.grid(visible=False)
    axes.tick_params(labelsize=6)


def forces(runs: dict[str, Recording], scattered: np.ndarray) -> Figure:
    """Resistance over depth of the four, and the mean of scattered normal ones, beside Table V.2."""

    def on(figure: Figure) -> None:
        axes = figure.add_subplot()
        depth = LAMBDA * FULL_DEPTH_MM
        mean, deviation = (1e3 * values for values in resistance(depth))
        axes.fill_between(depth, mean - deviation, mean + deviation, color=BAND, label="Table V.2, mean ± SD")
        axes.plot(depth, mean, color=GREY, linewidth=1.0, linestyle=(0, (4, 3)))
        axes.plot(
            depth, 1e3 * np.nanmean(scattered, axis=0), color=GREEN, linewidth=2.2, label=f"mean of {COUNT} scattered"
        )
        for (name, run), colour in zip(runs.items(), COLOURS, strict=True):
            rows = run.records[run.insertion]
            axes.plot(rows["depth_mm"], -1e3 * rows["force_axial_n"], color=colour, linewidth=1.0, label=name)
        axes.set_xlim(0.0, FULL_DEPTH_MM)
        axes.set_ylim(-20.0, 420.0)
        axes.set_xlabel("insertion depth [mm]")
        axes.set_ylabel("resistance [mN]")
        legend_above(axes, 3)

    return picture(on, 3.8)


def speeds(found: dict[float, np.ndarray]) -> Figure:
    """Mean resistance over depth at four speeds."""

    def on(figure: Figure) -> None:
        axes = figure.add_subplot()
        for (speed, axial), colour in zip(found.items(), COLOURS, strict=False):
            axes.plot(LAMBDA * FULL_DEPTH_MM, 1e3 * np.nanmean(axial, axis=0), color=colour, linewidth=1.2, label=f"{speed:g} mm/s")  # fmt: skip
        axes.set_xlim(0.0, FULL_DEPTH_MM)
        axes.set_xlabel("insertion depth [mm]")
        axes.set_ylabel(f"resistance, mean of {COUNT} [mN]")
        legend_above(axes, 3)

    return picture(on, 3.2)


def main() -> int:
    """Simulate and draw."""
    laboratory = Laboratory()
    seeds = range(10_000, 10_000 + COUNT)
    by_speed = {s: laboratory.insert([*BASE, f"workflow.speed_mm_per_s={s}"], seeds).axial_n for s in SPEEDS}
    laboratory.close()
    runs = {name: record(overrides) for name, overrides in FOUR.items()}
    for name, figure in (
        ("shapes", shapes(runs)),
        ("forces", forces(runs, by_speed[1.0])),
        ("speeds", speeds(by_speed)),
    ):
        figure.savefig(FOLDER / f"plant-{name}.png", dpi=DOTS_PER_INCH, metadata={"Software": None})
        print(FOLDER / f"plant-{name}.png")
    return 0


if __name__ == "__main__":
    sys.exit(main())
