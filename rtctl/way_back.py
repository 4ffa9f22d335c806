"""An array comes out the way it went in: the lateral correction of every depth is noted, and undone on the way back.

A correction that was right deep inside leads elsewhere at the entry, there against the bone and here out of the
workspace; where the array came through on its way in there is room for it.
"""

from hal.kernel import kernel

STEP_MM = 0.1
ROWS = 201
"""Every tenth of a millimetre of the deepest insertion, 20 mm."""


@kernel
def remember(way_mm, depth_mm, offset_mm):
    """Note the correction (3,) [mm] at a depth on the way in, in way (ROWS, 3): row k is for k tenths of a millimetre."""
    k = _row(depth_mm)
    for i in range(3):
        way_mm[k + 1, i] = offset_mm[i]


@kernel
def undo(way_mm, before_mm, depth_mm, offset_mm):
    """From depth `before_mm` back to `depth_mm`: change the correction (3,) by its share of the way to the next row.

    So it follows what was noted, without a step wherever the way back begins.
    """
    if not depth_mm < before_mm:
        return
    k = _row(depth_mm)
    share = min((before_mm - depth_mm) / (before_mm - k * STEP_MM), 1.0)
    for i in range(3):
        offset_mm[i] += share * (way_mm[k, i] - offset_mm[i])


@kernel
def _row(depth_mm):
    return min(max(int(depth_mm / STEP_MM), 0), ROWS - 2)
