"""A carriage that runs beside the tangent of its pulley: how long the wire really is (05 section 3; (III.34)-(III.47)).

u [mm] is the straight distance from the pulley's axis to the carriage along its way, n the carriage's offset from the
tangent, positive towards the axis, r the pulley's radius. Arguments may be arrays.
"""

import numpy as np
from numpy.typing import ArrayLike

from rtctl.calibrate.errors import CalibrationError


def wire_length(straight_mm: ArrayLike, offset_mm: ArrayLike, radius_mm: ArrayLike) -> np.ndarray:
    """h [mm]: wire from the top of the pulley to the carriage, round the pulley and then straight.

    h = r (pi/2 - theta_c) + sqrt(u^2 - 2 r n + n^2), theta_c = atan2(r - n, u) + atan2(sqrt(...), r): (III.36) and (III.39)
    to (III.41) corrected.

    Raises:
        CalibrationError: the carriage would be inside the pulley.
    """
    u, n, r = np.broadcast_arrays(*(np.asarray(v, dtype=float) for v in (straight_mm, offset_mm, radius_mm)))
    square = u**2 - 2 * r * n + n**2
    if not (square >= 0.0).all():
        raise CalibrationError("the carriage would be inside its pulley", value=float(u.flat[int(np.argmin(square))]), bound="u^2 of 2 r n - n^2 at least")  # fmt: skip
    free = np.sqrt(square)
    contact = np.arctan2(r - n, u) + np.arctan2(free, r)
    return r * (np.pi / 2 - contact) + free


def stretch(straight_mm: ArrayLike, offset_mm: ArrayLike, radius_mm: ArrayLike) -> np.ndarray:
    """h / u, about 1 + n^2 / 2 u^2: a ratio of lengths, which (III.47) calls a strain."""
    return wire_length(straight_mm, offset_mm, radius_mm) / np.asarray(straight_mm, dtype=float)


def travel_error_mm(home_mm: ArrayLike, travel_mm: ArrayLike, offset_mm: ArrayLike, radius_mm: ArrayLike) -> np.ndarray:
    """How much more wire than its own travel the carriage has paid out since home, never positive (III.43).

    home_mm: u* at home.
    """
    home, travel = np.asarray(home_mm, dtype=float), np.asarray(travel_mm, dtype=float)
    paid_out = wire_length(home + travel, offset_mm, radius_mm) - wire_length(home, offset_mm, radius_mm)
    return paid_out - travel


def travel_error_bound_mm(home_mm: ArrayLike, offset_mm: ArrayLike) -> np.ndarray:
    """Largest size of the error over any travel, n^2 / 2 u*, to leading order."""
    return np.asarray(offset_mm, dtype=float) ** 2 / (2 * np.asarray(home_mm, dtype=float))
