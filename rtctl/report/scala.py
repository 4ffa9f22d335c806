"""What pictures of an array in a cochlea are drawn of: walls, array, gripper, and where they lie in {B}."""

import math

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection

from rtctl.electrode import cochlea
from rtctl.electrode.array_shape import shape_points
from rtctl.electrode.patient import TEMPLATE, Cochlea
from rtctl.electrode.planning import APPROACH_RAD
from rtctl.report.style import BAND, FAINT, INK, RED

WALL_END_DEG, WALL_STEP_DEG = 480.0, 2.0
MODEL_POINTS = 73
MARGIN_MM = 1.0


class Placement:
    """Where a cochlea lies in {B}: its entry [mm], the turn [rad] from {C} to {B}, its size against the template's."""

    def __init__(self, entry_mm: np.ndarray, turn_rad: float, scale: float = 1.0) -> None:
        self.entry_mm, self.turn_rad, self.scale = np.asarray(entry_mm, dtype=float), turn_rad, scale

    @classmethod
    def of_registration(cls, pose_entry: np.ndarray, patient: Cochlea = TEMPLATE) -> "Placement":
        """Where the controller believes that of `patient` to be, from the registered gripper pose (3,)."""
        return cls(pose_entry[:2], float(pose_entry[2]) - APPROACH_RAD, patient.scale)

    def to_base(self, points_in_cochlea: np.ndarray) -> np.ndarray:
        """Points (n, 2) of the template in {B} [mm]."""
        c, s = math.cos(self.turn_rad), math.sin(self.turn_rad)
        turned = (points_in_cochlea - cochlea.insertion_point()) @ np.array([[c, s], [-s, c]])
        return self.entry_mm + self.scale * turned

    def walls(self) -> tuple[np.ndarray, np.ndarray]:
        """Lateral and modiolar wall (n, 2) in {B} [mm]."""
        return (
            self.to_base(cochlea.lateral_polyline(WALL_STEP_DEG, WALL_END_DEG)),
            self.to_base(cochlea.modiolar_polyline(WALL_STEP_DEG, WALL_END_DEG)),
        )


def model_array(modal_matrix: np.ndarray, length_mm: float, pose: np.ndarray, stylet_mm: float) -> np.ndarray:
    """The controller's array (n, 2) in {B} [mm], free of contact, at a gripper pose (3,) and stylet withdrawal."""
    points = np.empty((MODEL_POINTS, 2))
    shape_points(modal_matrix, stylet_mm, np.linspace(0.0, length_mm, MODEL_POINTS), points)
    x, y, phi = pose
    c, s = math.cos(phi), math.sin(phi)
    return np.array([x, y]) + points @ np.array([[c, s], [-s, c]])


def draw_scala(axes: Axes, walls: tuple[np.ndarray, np.ndarray]) -> None:
    """The channel between the walls, piece by piece because its turns pass inside each other."""
    lateral, modiolar = walls
    pieces = np.stack((lateral[:-1], lateral[1:], modiolar[1:], modiolar[:-1]), axis=1)
    axes.add_collection(PolyCollection(list(pieces), facecolors=BAND, edgecolors=BAND, linewidths=0.4, zorder=0.5))
    for wall in walls:
        axes.plot(*wall.T, color=FAINT, linewidth=1.4, zorder=0.8)


def draw_array(axes: Axes, points: np.ndarray, colour: str, width: float) -> None:
    """An array (n, 2) with a cross at its tip."""
    axes.plot(*points.T, color=colour, linewidth=width, solid_capstyle="round")
    axes.plot(*points[-1], marker="x", color=RED if width > 2 else colour, markersize=4)


def draw_entry(axes: Axes, entry_mm: np.ndarray) -> None:
    """The centre of the cochleostomy."""
    axes.plot(*entry_mm[:2], marker="o", color=INK, markersize=3.5, markerfacecolor="white", zorder=3)


def draw_gripper(axes: Axes, pose: np.ndarray) -> None:
    """A bar behind the grip ribs."""
    x, y, phi = pose
    back = np.array([x, y]) - 6.0 * np.array([math.cos(phi), math.sin(phi)])
    axes.plot([back[0], x], [back[1], y], color=INK, linewidth=5, solid_capstyle="butt")


def frame(
    axes: Axes, walls: tuple[np.ndarray, np.ndarray], before_mm: float = 2.2, below_mm: float = MARGIN_MM
) -> None:
    """Show the cochlea with room before its entry and below it."""
    low, high = np.min(np.vstack(walls), axis=0), np.max(np.vstack(walls), axis=0)
    axes.set_xlim(low[0] - before_mm, high[0] + MARGIN_MM)
    axes.set_ylim(low[1] - below_mm, high[1] + MARGIN_MM)


def plain(axes: Axes) -> None:
    """No grid, and both directions alike."""
    axes.set_aspect("equal")
    axes.grid(visible=False)
    axes.tick_params(labelsize=7.5)
