"""The robot path of an insertion as the tick reads it: piecewise cubics over depth in one record.

Channels are the coordinates of the gripper pose in the robot base {B} (planar: x mm, y mm, phi rad) and, last, the
stylet withdrawal [mm]. In interval i the value of channel c is the cubic coefficient[i, c, :], highest power first, in
the local variable d - depth_mm[i].
"""

import numpy as np

from hal.kernel import kernel

MAX_KNOTS = 64
MAX_CHANNELS = 7

PATH = np.dtype(
    [
        ("number", "i8"),  # of the plan it came from, 0 for none
        ("intervals", "i8"),  # in use, one less than knots
        ("channels", "i8"),  # in use, degrees of freedom and the stylet
        ("depth_mm", "f8", (MAX_KNOTS,)),
        ("coefficient", "f8", (MAX_KNOTS - 1, MAX_CHANNELS, 4)),
        ("insertion_axis_in_base", "f8", (3,)),  # unit vector along which the tip passes the entry
        ("entry_in_base", "f8", (3,)),  # centre p_c of the cochleostomy [mm]
    ],
    align=True,
)


@kernel
def evaluate_path(path, depth_mm, value, slope):
    """Value of every channel at a depth into `value`, its derivative by depth [1/mm] into `slope`.

    Outside the knots the path rests at its ends: the end's value, no slope. A depth that is NaN gives NaN.
    """
    last = path.intervals - 1
    end = path.depth_mm[path.intervals]
    resting = depth_mm < path.depth_mm[0] or depth_mm > end
    depth = min(max(depth_mm, path.depth_mm[0]), end) if resting else depth_mm
    i = 0
    while i < last and depth >= path.depth_mm[i + 1]:
        i += 1
    u = depth - path.depth_mm[i]
    for c in range(path.channels):
        c3, c2 = path.coefficient[i, c, 0], path.coefficient[i, c, 1]
        c1, c0 = path.coefficient[i, c, 2], path.coefficient[i, c, 3]
        value[c] = c0 + u * (c1 + u * (c2 + u * c3))
        slope[c] = 0.0 if resting else c1 + u * (2.0 * c2 + u * 3.0 * c3)
