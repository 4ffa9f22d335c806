"""The array in the cochlea at five depths."""

from collections.abc import Callable

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from rtctl.electrode import cochlea
from rtctl.planner import cochlea_of
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
from rtctl.report.style import BLUE, FAINT, GREY, INK, ORANGE, RED, picture
from rtctl.summary import Run

MODEL_CAPTION = (
    "Looking onto the plane of insertion. Shaded: the scala tympani where the controller believes it is, placed by the "
    "registered entry. Orange: its model of the array, free of contact, at the measured gripper and stylet."
)
LEFT_CAPTION = (
    " A left ear: the robot is mounted turned over, and {B} shows it from below, where it looks like a right one."
)
TRUE_CAPTION = (
    " Dashed and blue: where the scala and the array truly are in this simulation. Lines are the array's modiolar edge; "
    "its body is half a millimetre or more wide and lies on the other side. Red: what walls and entry do to it."
)
SHARES = (0.2, 0.4, 0.6, 0.8, 1.0)
"""The five depths, as shares of the deepest."""
MM_PER_N, LEAST_N = 20.0, 5e-4
"""Length of a force in the picture, and the least one that is drawn."""


def caption(run: Run) -> str:
    """What the picture shows, which depends on whether the truth is known."""
    left = LEFT_CAPTION if run.recording.settings.cochlea.side == "left" else ""
    return MODEL_CAPTION + left + (TRUE_CAPTION if _true_rows(run) is not None else "")


def draw(run: Run) -> Figure | None:
    """The picture, or None if nothing was inserted, or the robot does not work in this plane."""
    entry = run.records["pose_entry"][-1]
    if len(run.inserting) < 2 or len(entry) != 3 or not np.isfinite(entry).all():
        return None
    place = Placement.of_registration(entry, cochlea_of(run.recording.settings))
    truth = _true_rows(run)
    true_place = true_placement(run.recording.truths)
    picks = [int(np.argmax(run.inserting["depth_mm"] >= share * run.depth_mm - 1e-9)) for share in SHARES]
    walls = place.walls()

    def on(figure: Figure) -> None:
        panels = figure.subplots(3, 2).ravel()
        for axes, k in zip(panels, [*picks, picks[-1]], strict=True):
            row = run.inserting[k]
            draw_scala(axes, walls)
            if true_place is not None:
                for wall in true_place.walls():
                    axes.plot(*wall.T, color=GREY, linewidth=0.8, linestyle=(0, (4, 3)))
            draw_array(axes, _model_array(run, row), ORANGE, 1.3)
            if truth is not None:
                draw_truth(axes, truth(int(row["tick"])))
            draw_entry(axes, place.entry_mm)
            plain(axes)
        for axes, k in zip(panels, picks, strict=False):
            row = run.inserting[k]
            frame(axes, walls)
            axes.set_title(f"{row['depth_mm']:.1f} mm, stylet {row['stylet_measured_mm']:.1f} mm", loc="left")
        draw_gripper(panels[-1], run.inserting[picks[-1]]["pose_measured"])
        panels[-1].set_title("with the gripper", loc="left")
        panels[-1].autoscale()
        panels[-1].margins(0.06)
        handles = [
            Line2D([], [], color=FAINT, linewidth=1.4, label="walls, registered"),
            Line2D([], [], color=ORANGE, linewidth=1.3, label="array, model"),
            Line2D([], [], color=INK, marker="o", linewidth=0, markersize=3.5, markerfacecolor="white", label="entry"),
        ]
        if true_place is not None:
            handles.insert(1, Line2D([], [], color=GREY, linewidth=0.8, linestyle=(0, (4, 3)), label="walls, true"))
        if truth is not None:
            handles.append(Line2D([], [], color=BLUE, linewidth=2.4, label="array, true"))
            handles.append(
                Line2D([], [], color=RED, linewidth=1.0, label=f"force on it, {1e3 / MM_PER_N:.0f} mN per mm")
            )
        figure.legend(handles=handles, loc="outside upper left", ncols=3)
        for axes in panels[4:]:
            axes.set_xlabel("x in {B} [mm]")
        for axes in panels[::2]:
            axes.set_ylabel("y in {B} [mm]")

    return picture(on, 7.4)


def true_placement(truths: np.ndarray | None) -> Placement | None:
    """Where a simulated cochlea really is, if the truths (n,) tell."""
    if truths is None or not len(truths) or "cochlea_scale" not in (truths.dtype.names or ()):
        return None
    row = truths[-1]
    turn = float(row["insertion_angle_rad"]) - cochlea.insertion_path().direction_rad
    return Placement(row["entry_in_base_mm"], turn, float(row["cochlea_scale"]))


def _true_rows(run: Run) -> Callable[[int], np.void] | None:
    """Function from a tick to what is true then; None if the array is not known."""
    truths = run.recording.truths
    if truths is None or "array_node_in_base_mm" not in (truths.dtype.names or ()):
        return None
    return lambda tick: truths[min(int(np.searchsorted(truths["tick"], tick)), len(truths) - 1)]


def _model_array(run: Run, row: np.void) -> np.ndarray:
    """The controller's array (n, 2) in {B} [mm] at the measured gripper pose and stylet withdrawal."""
    electrode = run.recording.settings.electrode
    matrix, stylet = np.array(electrode.modal_matrix), float(row["stylet_measured_mm"])
    return model_array(matrix, electrode.length_mm, row["pose_measured"], stylet)


def draw_truth(axes: Axes, truth: np.void, width: float = 2.4) -> None:
    """The true array and, where they are known, the forces on it."""
    points = truth["array_node_in_base_mm"].reshape(-1, 2)
    draw_array(axes, points, BLUE, width)
    if "contact_force_in_base_n" not in (truth.dtype.names or ()):
        return
    forces = truth["contact_force_in_base_n"].reshape(-1, 2)
    felt = np.linalg.norm(forces, axis=1) > LEAST_N
    lines = np.stack((points[felt], points[felt] + MM_PER_N * forces[felt]), axis=1)
    axes.add_collection(LineCollection(list(lines), colors=RED, linewidths=1.0, zorder=2.6))
