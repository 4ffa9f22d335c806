"""Two runs in one picture: what they measured and corrected, over time or over depth."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from rtctl.hil.comparison import inserting
from rtctl.report.style import BLUE, ORANGE, legend_above, picture, save, thin

Values = Callable[[np.ndarray], np.ndarray]
PANELS: tuple[tuple[str, Values], ...] = (
    ("x [mm]", lambda rows: rows["pose_measured"][:, 0]),
    ("y [mm]", lambda rows: rows["pose_measured"][:, 1]),
    ("stylet [mm]", lambda rows: rows["stylet_measured_mm"]),
    ("axial [mN]", lambda rows: 1e3 * rows["force_axial_n"]),
    ("lateral [mN]", lambda rows: 1e3 * rows["force_lateral_n"]),
    ("corrected [mm]", lambda rows: np.linalg.norm(rows["admittance_offset_mm"], axis=1)),
)


def draw(one: np.ndarray, other: np.ndarray, by: str, names: tuple[str, str], target: Path) -> None:
    """Write the picture of two runs, records (n,) and (m,), aligned by "tick" or "depth".

    Raises:
        RtctlError: by depth, and one has no insertion; the file cannot be written.
    """
    runs = [inserting(rows) for rows in (one, other)] if by == "depth" else [one, other]

    def on(figure: Figure) -> None:
        panels = figure.subplots(len(PANELS), 1, sharex=True)
        for axes, (label, values) in zip(panels, PANELS, strict=True):
            for rows, name, colour, style in zip(runs, names, (BLUE, ORANGE), ("-", "--"), strict=True):
                x = rows["depth_mm"] if by == "depth" else rows["tick"]
                drawn = thin(x)
                axes.plot(x[drawn], values(rows)[drawn], style, color=colour, label=name)
            axes.set_ylabel(label)
        legend_above(panels[0], 1)
        panels[-1].set_xlabel("depth [mm]" if by == "depth" else "tick")

    save(picture(on, 1.25 * len(PANELS)), target)
