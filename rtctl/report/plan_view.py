"""A plan as a picture: the array at six depths of the cochlea, and the cone of the facial recess."""

import math

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from rtctl.electrode.array_shape import LENGTH_MM
from rtctl.electrode.planning import Plan
from rtctl.electrode.robot_path import poses_in_base
from rtctl.report.scala import (
    Placement,
    draw_array,
    draw_entry,
    draw_gripper,
    draw_scala,
    frame,
    model_array,
    plain,
)
from rtctl.report.style import FAINT, GREY, ORANGE, picture

PANELS = 6
CONE_MM = 9.0
"""How far before the entry the cone is drawn."""
ROOM_MM = (8.0, 3.0)
"""Before the cochlea and below it, where the gripper is in the end."""


def draw(plan: Plan, pose_entry: np.ndarray, recess_angle_rad: float) -> Figure:
    """The picture of `plan` at a registered entry pose (3,) in {B}, with the recess's half angle."""
    place = Placement.of_registration(pose_entry, plan.cochlea)
    walls = place.walls()
    poses = poses_in_base(plan.pose_in_cochlea, pose_entry, plan.cochlea)
    picks = np.linspace(0, len(plan.depth_mm) - 1, PANELS).round().astype(int)

    def on(figure: Figure) -> None:
        panels = figure.subplots(3, 2).ravel()
        for axes, k in zip(panels, picks, strict=True):
            draw_scala(axes, walls)
            _cone(axes, pose_entry, recess_angle_rad)
            array = model_array(plan.modal_matrix, LENGTH_MM, poses[k], float(plan.stylet_mm[k]))
            draw_array(axes, array, ORANGE, 1.3)
            draw_entry(axes, place.entry_mm)
            plain(axes)
            frame(axes, walls, *ROOM_MM)
            title = f"{plan.depth_mm[k]:.1f} mm, stylet {plan.stylet_mm[k]:.1f} mm, rms {plan.rms_mm[k]:.2f} mm"
            axes.set_title(title, loc="left", fontsize=8)
            draw_gripper(axes, poses[k])
        figure.legend(
            handles=[
                Line2D([], [], color=FAINT, linewidth=1.4, label="walls"),
                Line2D([], [], color=ORANGE, linewidth=1.3, label="array, free of contact"),
                Line2D([], [], color=GREY, linewidth=0.8, linestyle=(0, (4, 3)), label="cone of the facial recess"),
            ],
            loc="outside upper left",
            ncols=3,
        )
        for axes in panels[4:]:
            axes.set_xlabel("x in {B} [mm]")
        for axes in panels[::2]:
            axes.set_ylabel("y in {B} [mm]")

    return picture(on, 6.2)


def _cone(axes: Axes, entry: np.ndarray, angle_rad: float) -> None:
    """From the entry outwards, about the registered direction."""
    for side in (-angle_rad, angle_rad):
        bearing = entry[2] + math.pi + side
        x, y = entry[0] + CONE_MM * math.cos(bearing), entry[1] + CONE_MM * math.sin(bearing)
        axes.plot([entry[0], x], [entry[1], y], color=GREY, linewidth=0.8, linestyle=(0, (4, 3)), zorder=0.9)
