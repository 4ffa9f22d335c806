"""Impedance between two neighbouring contacts in front of the modiolar wall (04 sections 1 and 2; (VII.4) to (VII.18)).

The fluid between them is a trapezoid: contact, silicone and contact on the x axis from 0 to 0.82 mm, the wall above them,
`h_mm` away at the source and inclined by `alpha_rad`. The current enters through the source C1, leaves through the sink
C3, which is at 0 V, and passes through no other side.
"""

import math

import numpy as np

from hal.errors import RtctlError
from rtctl.guidance.impedance.boundary_elements import Boundary, polygon, solve

CONTACT_MM = 0.2
"""L_1 = L_3, along the array."""
SILICONE_MM = 0.42
"""L_2."""
WIDTH_MM = 2.0 * CONTACT_MM + SILICONE_MM
CONDUCTIVITY_S_PER_MM = 1.6e-3
"""sigma of saline: 16 mS/cm; Table VII.2 has S/cm, which is a misprint (04 section 5)."""
DEPTH_MM = 1.0
"""w: what a model in the plane leaves open; 1 mm reproduces the sources."""
CURRENT_A = 75e-6
RATIO = np.array([1, 2, 1, 1, 3, 1])
"""Elements of C1 to C6, in elements of C1 (Table VII.3)."""
RESOLUTION = 30
SOURCE, SINK = 0, 2


class PairError(RtctlError):
    """A pair of contacts there is no model for."""


def area_mm2(h_mm: float, alpha_rad: float) -> float:
    """A_R of the trapezoid (04 section 1)."""
    return WIDTH_MM * h_mm + 0.5 * WIDTH_MM**2 * math.tan(alpha_rad)


def fluid(h_mm: float, alpha_rad: float, resolution: int = RESOLUTION, *, source_far: bool = False) -> Boundary:
    """The trapezoid as a boundary of 9 `resolution` elements.

    source_far: the source is at the wide end, the sink at the narrow one.

    Raises:
        PairError: h is not positive, alpha is not in [0, pi/2), or there is no element.
    """
    if not (math.isfinite(h_mm) and h_mm > 0.0):
        raise PairError("the distance to the wall must be positive", value=h_mm, bound="above 0 mm")
    if not 0.0 <= alpha_rad < 0.5 * math.pi:
        raise PairError("the wall's inclination is not that of a trapezoid", value=alpha_rad, bound="0 .. pi/2 rad")
    if resolution < 1:
        raise PairError("a contact needs an element", value=resolution, bound="at least 1")
    far = CONTACT_MM + SILICONE_MM
    corner = [(0.0, 0.0), (CONTACT_MM, 0.0), (far, 0.0), (WIDTH_MM, 0.0)]
    corner += [(WIDTH_MM, h_mm + WIDTH_MM * math.tan(alpha_rad)), (0.0, h_mm)]
    source, sink = (SINK, SOURCE) if source_far else (SOURCE, SINK)
    flux, at_zero = np.zeros(6), np.zeros(6, dtype=bool)
    flux[source] = CURRENT_A / (CONTACT_MM * DEPTH_MM * CONDUCTIVITY_S_PER_MM)
    at_zero[sink] = True
    return polygon(np.array(corner), resolution * RATIO, at_zero, flux)


def impedance_ohm(h_mm: float, alpha_rad: float, resolution: int = RESOLUTION, *, source_far: bool = False) -> float:
    """Bipolar impedance z [ohm]: the mean potential of the source over the current (VII.18).

    Raises:
        PairError: see :func:`fluid`.
    """
    boundary = fluid(h_mm, alpha_rad, resolution, source_far=source_far)
    potential, _ = solve(boundary)
    return float(potential[boundary.curve == (SINK if source_far else SOURCE)].mean() / CURRENT_A)
