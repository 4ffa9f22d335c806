"""The robot's path in the plane of insertion, and how far the gripper was from it."""

import numpy as np
from matplotlib.figure import Figure

from rtctl.report.style import BLUE, GREEN, GREY, INK, ORANGE, legend_above, picture, thin
from rtctl.summary import Run

CAPTION = (
    "Gripper tip in the robot's base frame {B} during the insertion. The lateral force law moves the "
    "planned path to the reference; the robot follows the reference. Below: distance of the tip from the reference, as "
    "the robot measures it and, in a simulation, as it truly is, and the size of the correction."
)


def draw(run: Run) -> Figure | None:
    """The picture, or None if nothing was inserted."""
    if len(run.inserting) < 2:
        return None
    rows, truth = run.inserting, None
    pair = run.recording.paired
    if pair is not None and "pose_gripper_in_base" in (pair[1].dtype.names or ()):
        both = np.isin(pair[0]["tick"], rows["tick"])
        rows, truth = pair[0][both], pair[1][both]["pose_gripper_in_base"]
    keep, plane = thin(rows), slice(0, 2)
    rows, truth = rows[keep], None if truth is None else truth[keep]
    reference = rows["pose_reference"][:, plane]

    def on(figure: Figure) -> None:
        top, bottom = figure.subplots(2, 1, height_ratios=(3, 2))
        curves = [
            ("planned", rows["pose_desired"], GREY, (0, (4, 3)), 1.4),
            ("reference", rows["pose_reference"], INK, "-", 1.0),
        ]
        if truth is not None:
            curves.append(("true", truth, GREEN, "-", 1.2))
        curves.append(("measured", rows["pose_measured"], BLUE, "-", 1.4))
        for label, pose, colour, dashes, width in curves:
            top.plot(pose[:, 0], pose[:, 1], color=colour, linestyle=dashes, linewidth=width, label=label)
        top.plot(*reference[0], marker="o", color=INK, markersize=4)
        top.annotate("start", reference[0], xytext=(4, -12), textcoords="offset points", fontsize=8)
        top.set_aspect("equal", adjustable="datalim")
        top.set_xlabel("x in {B} [mm]")
        top.set_ylabel("y in {B} [mm]")
        legend_above(top, 4)

        depth = rows["depth_mm"]
        correction = np.linalg.norm(rows["admittance_offset_mm"], axis=1)
        bottom.plot(depth, correction, color=ORANGE, linewidth=1.2, label="correction")
        if truth is not None:
            bottom.plot(depth, _distance(truth, reference), color=GREEN, linewidth=1.2, label="true − reference")
        bottom.plot(depth, _distance(rows["pose_measured"], reference), color=BLUE, label="measured − reference")
        bottom.set_xlim(0.0, depth.max())
        bottom.set_ylim(bottom=0.0)
        bottom.set_xlabel("insertion depth [mm]")
        bottom.set_ylabel("distance [mm]")
        legend_above(bottom, 3)

    return picture(on, 5.2)


def _distance(pose: np.ndarray, reference: np.ndarray) -> np.ndarray:
    return np.linalg.norm(pose[:, :2] - reference, axis=1)
