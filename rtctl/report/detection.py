"""What the failure detectors predicted and decided, against depth."""

import numpy as np
from matplotlib.figure import Figure

from rtctl.guidance.force_model import FULL_DEPTH_MM
from rtctl.guidance.layout import BUCKLED, FOLDED
from rtctl.report.style import BLUE, GREY, INK, ORANGE, RED, VIOLET, legend_above, picture
from rtctl.summary import Run

CAPTION = (
    "Above: measured resistance, and what it was predicted to be at 13.8 mm. Below: the decision h on the predicted insertion, "
    "which calls it a tip fold where it falls under minus its bound, and the two integrals as shares of their largest normal "
    "value, which call it buckling once both have been above 1."
)


def draw(run: Run) -> Figure | None:
    """The picture, or None if no detector watched."""
    rows = run.inserting
    rows = rows[np.flatnonzero(np.diff(rows["detector_samples"], prepend=0) > 0)] if _knows(rows) else rows[:0]
    if len(rows) < 2:
        return None
    depth, flags = rows["depth_mm"], rows["detector_flags"]
    with np.errstate(divide="ignore", invalid="ignore"):
        shares = np.where(rows["buckling_bound"] > 0.0, rows["buckling_integral"] / rows["buckling_bound"], np.nan)

    def on(figure: Figure) -> None:
        force, decision = figure.subplots(2, 1, sharex=True)
        force.plot(depth, -1e3 * rows["predicted_force_n"], color=ORANGE, label="predicted at 13.8 mm")
        force.plot(depth, -1e3 * rows["force_axial_n"], color=BLUE, label="measured")
        force.set_ylabel("resistance [mN]")
        legend_above(force, 2)
        decision.plot(depth, rows["fold_decision"], color=INK, label="h")
        decision.plot(depth, -rows["fold_bound"], color=RED, linestyle=(0, (4, 3)), label="−bound")
        decision.plot(depth, shares[:, 0], color=BLUE, linewidth=1.0, label="φ₁")
        decision.plot(depth, shares[:, 1], color=VIOLET, linewidth=1.0, label="φ₂")
        decision.axhline(0.0, color=GREY, linewidth=0.8)
        for bit, text in ((FOLDED, "tip fold"), (BUCKLED, "buckling")):
            if (flags & bit).any():
                at = depth[np.flatnonzero(flags & bit)[0]]
                decision.axvline(at, color=RED, linewidth=0.9, linestyle=":")
                decision.text(at, 0.02, f" {text}", fontsize=7.5, color=INK, transform=decision.get_xaxis_transform())
        decision.set_xlim(0.0, FULL_DEPTH_MM * 1.01)
        decision.set_xlabel("insertion depth [mm]")
        decision.set_ylabel("decision, share")
        legend_above(decision, 4)

    return picture(on, 4.6)


def _knows(rows: np.ndarray) -> bool:
    """False for logs of before there were detectors."""
    return "detector_samples" in (rows.dtype.names or ())
