"""Digitised shapes of an array and what the modal model makes of them (as II.7), and the residuals along it."""

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure

from rtctl.electrode.array_shape import LENGTH_MM, STYLET_MAX_MM
from rtctl.electrode.image_calibration import Calibration
from rtctl.report.scala import model_array
from rtctl.report.style import INK, picture

COLOURS = colormaps["viridis"]


def draw(calibration: Calibration) -> Figure:
    """The picture of a calibration."""

    def on(figure: Figure) -> None:
        shapes, residuals = figure.subplots(2, 1, height_ratios=(1.4, 1.0))
        _shapes(shapes, calibration)
        _residuals(residuals, calibration)
        withdrawal = ScalarMappable(Normalize(0.0, STYLET_MAX_MM), COLOURS)
        figure.colorbar(withdrawal, ax=[shapes, residuals], label="stylet withdrawal [mm]", shrink=0.5, aspect=30)
        residuals.set_title(f"{calibration.rms_rad:.4f} rad rms", loc="left")

    return picture(on, 5.6)


def _shapes(axes: Axes, calibration: Calibration) -> None:
    for image in calibration.images:
        colour = COLOURS(image.stylet_mm / STYLET_MAX_MM)
        model = model_array(calibration.modal_matrix, LENGTH_MM, np.zeros(3), image.stylet_mm)
        points = image.points_mm - image.points_mm[0]
        axes.plot(*model.T, color=colour, linewidth=1.1)
        axes.plot(*points.T, color=colour, marker="o", markersize=2.4, linewidth=0)
    axes.set_aspect("equal")
    axes.set_title("points: digitised; lines: fitted", loc="left")
    axes.set_xlabel("x in {E} [mm]")
    axes.set_ylabel("y in {E} [mm]")


def _residuals(axes: Axes, calibration: Calibration) -> None:
    axes.axhline(0.0, color=INK, linewidth=0.8)
    for image, residual in zip(calibration.images, calibration.residual_rad, strict=True):
        arc = image.arc_mm
        axes.plot((arc[:-1] + arc[1:]) / 2, residual, color=COLOURS(image.stylet_mm / STYLET_MAX_MM), linewidth=0.9)
    axes.set_xlabel("arc length from the grip [mm]")
    axes.set_ylabel("model - measured [rad]")
