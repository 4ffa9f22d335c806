"""The cochlea of one patient: the template scaled by A, of a right or a left ear (spec 02 section 1, 08 section 1).

Both branches of (II.1) are proportional to A, and widths and heights are scaled with them, so a patient's cochlea is
the template enlarged about the centre of its spiral. Angles stay what they are: the point of tangency, the direction
of insertion, the gripper's mean orientation.

A left cochlea is the mirror image of a right one. {C} of a left ear has its z axis the other way, so that theta is
counter-clockwise again, and the robot is mounted turned over about x of {B}, so that {B} shows the same plane as it
does for a right ear. Walls, plan and path are therefore those of a right ear of the same A. What comes from
outside changes its sign along y and z of {B}: gravity, and whatever a surgeon sees from above.
"""

import math
from dataclasses import dataclass

import numpy as np

from rtctl.electrode import cochlea
from rtctl.electrode.cochlea import PATH_END_DEG, SPIRAL_A_MM, InsertionPath

SIDES = ("right", "left")
SMALLEST_A_MM, LARGEST_A_MM = 3.2, 4.6

RECESS_ANGLE_RAD, RECESS_CLEARANCE_MM = math.radians(17.0), 2.0
"""The facial recess as the entry sees it, along its long axis, and its half width (II.2; 10 degrees are the mean)."""


@dataclass(frozen=True)
class Cochlea:
    """Walls, entry and path in {C} of the patient [mm].

    spiral_a_mm: A of (II.1); larger in men than in women.
    side: "right" or "left", the ear.
    """

    spiral_a_mm: float = SPIRAL_A_MM
    side: str = "right"

    @property
    def scale(self) -> float:
        """Size against the template's."""
        return self.spiral_a_mm / SPIRAL_A_MM

    def insertion_point(self) -> np.ndarray:
        """Centre p_c (2,) of the cochleostomy."""
        return self.scale * cochlea.insertion_point()

    def path(self, step_deg: float = 0.25) -> InsertionPath:
        """Where the tip should be at a depth; it ends where the template's wall collapses."""
        template = cochlea.insertion_path(step_deg)
        return InsertionPath(self.scale * template.vertices, self.scale * template.length_mm, template.tangency_deg)

    def modiolar_polyline(self, step_deg: float, last_deg: float = PATH_END_DEG) -> np.ndarray:
        """Vertices (n, 2) of the modiolar wall."""
        return self.scale * cochlea.modiolar_polyline(step_deg, last_deg)

    def lateral_polyline(self, step_deg: float, last_deg: float = PATH_END_DEG) -> np.ndarray:
        """Vertices (n, 2) of the lateral wall."""
        return self.scale * cochlea.lateral_polyline(step_deg, last_deg)


TEMPLATE = Cochlea()
"""A right ear of mean size."""
