"""What an insertion path must satisfy before the controller follows it, wherever it came from."""

import numpy as np

from hal.errors import RtctlError
from rtctl.electrode.array_shape import LENGTH_MM, STYLET_MAX_MM
from rtctl.electrode.path import MAX_CHANNELS, MAX_KNOTS, PATH

TOLERANCE = 1e-6
"""mm, rad or per mm: above rounding, far below anything a robot resolves."""
REMEDY = "plan the insertion again"


def validate_path(path: np.ndarray, dof: int) -> None:
    """Check a path record for a robot with `dof` pose coordinates; whether the robot reaches it is asked elsewhere.

    Args:
        path: array (1,) of dtype PATH.

    Raises:
        RtctlError: wrong layout or size, a number that is not finite, depths that do not increase or leave the
            array's length, a jump of a channel at a knot, a stylet that goes back in or leaves its stroke, an insertion
            axis that is no unit vector.
    """
    if path.dtype != PATH or path.shape != (1,):
        raise RtctlError("not one insertion path", value=(path.shape, path.nbytes), bound=f"{PATH.itemsize} bytes")
    record = path[0]
    intervals, channels = int(record["intervals"]), int(record["channels"])
    if not 1 <= intervals < MAX_KNOTS:
        raise RtctlError("path has a wrong number of intervals", value=intervals, bound=f"1 .. {MAX_KNOTS - 1}")
    if channels != dof + 1 or channels > MAX_CHANNELS:
        raise RtctlError("path is for another robot", value=channels, bound=f"{dof} pose coordinates and the stylet")
    depth, coefficient = record["depth_mm"][: intervals + 1], record["coefficient"][:intervals, :channels]
    for name, numbers in (
        ("depths", depth),
        ("coefficients", coefficient),
        ("insertion axis", record["insertion_axis_in_base"]),
        ("entry", record["entry_in_base"]),
    ):
        if not np.isfinite(numbers).all():
            bad = float(numbers[~np.isfinite(numbers)][0])
            raise RtctlError(f"path has {name} that are no numbers", value=bad, bound="finite", remedy=REMEDY)
    _check_depths(depth)
    _check_jumps(depth, coefficient)
    _check_stylet(np.diff(depth), coefficient[:, -1])
    length = float(np.linalg.norm(record["insertion_axis_in_base"]))
    if abs(length - 1) > TOLERANCE:
        raise RtctlError("path has an insertion axis that is no unit vector", value=length, bound="length 1")


def _check_depths(depth: np.ndarray) -> None:
    step = float(np.diff(depth).min())
    if step <= 0:
        raise RtctlError("path has knots that do not increase", value=step, bound="above 0 mm", remedy=REMEDY)
    for end in (float(depth[0]), float(depth[-1])):
        if not 0 <= end <= LENGTH_MM:
            raise RtctlError("path leaves the depth of the array", value=end, bound=f"0 .. {LENGTH_MM:g} mm")


def _check_jumps(depth: np.ndarray, coefficient: np.ndarray) -> None:
    powers = np.diff(depth)[:, None] ** np.array([3, 2, 1, 0])
    ends = np.einsum("icp,ip->ic", coefficient, powers)
    jumps = np.abs(ends[:-1] - coefficient[1:, :, 3])
    if jumps.size and jumps.max() > TOLERANCE:
        knot, channel = np.unravel_index(np.argmax(jumps), jumps.shape)
        what = f"path jumps at depth {depth[knot + 1]:g} mm in channel {channel}"
        raise RtctlError(what, value=float(jumps.max()), bound=f"at most {TOLERANCE:g}", remedy=REMEDY)


def _check_stylet(width: np.ndarray, stylet: np.ndarray) -> None:
    """The least slope of a cubic is at an end of its interval or at the vertex of its derivative."""
    c3, c2, c1, c0 = stylet.T
    vertex = np.divide(-c2, 3 * c3, out=np.zeros_like(c2), where=c3 != 0)
    slopes = [c1 + u * (2 * c2 + u * 3 * c3) for u in (np.zeros_like(width), width, np.clip(vertex, 0, width))]
    least = float(np.min(slopes))
    if least < -TOLERANCE:
        raise RtctlError("path puts the stylet back in", value=least, bound="slope at least 0", remedy=REMEDY)
    last = c0[-1] + width[-1] * (c1[-1] + width[-1] * (c2[-1] + width[-1] * c3[-1]))
    for end in (float(c0[0]), float(last)):
        if not -TOLERANCE <= end <= STYLET_MAX_MM + TOLERANCE:
            raise RtctlError("path leaves the stylet's stroke", value=end, bound=f"0 .. {STYLET_MAX_MM:g} mm")
