"""A path that arrives over the network is checked before anything follows it."""

import numpy as np
import pytest

from hal.errors import RtctlError
from rtctl.electrode.path import PATH
from rtctl.electrode.path_validation import validate_path
from rtctl.electrode.planning import plan_insertion
from rtctl.electrode.robot_path import robot_path
from rtctl.electrode.synthetic_arrays import mean_modal_matrix, modal_matrix

GOOD = robot_path(plan_insertion(modal_matrix(1)), np.array([172.0, 5.0, 0.0]), number=1)


@pytest.mark.parametrize("modal", [*(modal_matrix(k) for k in range(1, 8)), mean_modal_matrix()])
def test_planned_paths_pass(modal):
    path = robot_path(plan_insertion(modal), np.array([172.0, 5.0, 0.1]), number=1)
    validate_path(path, dof=3)
    validate_path(np.frombuffer(path.tobytes(), PATH), dof=3)


def spoil(field, index, value):
    path = GOOD.copy()
    if index is None:
        path[0][field] = value
    else:
        path[0][field][index] = value
    return path


STYLET_BACK, STYLET_DIP = GOOD.copy(), GOOD.copy()
STYLET_BACK[0]["coefficient"][:30, 3] = np.column_stack(
    (np.zeros(30), np.zeros(30), np.full(30, -0.5), 15 - 0.25 * np.arange(30))
)
# 8 u^3 - 6 u^2 + u: every interval starts and ends at 0 with a rising stylet, and dips at its middle
STYLET_DIP[0]["coefficient"][:30, 3] = (8.0, -6.0, 1.0, 0.0)


@pytest.mark.parametrize(
    ("path", "message"),
    [
        (spoil("intervals", None, 0), "number of intervals: got 0"),
        (spoil("intervals", None, 64), "number of intervals: got 64"),
        (spoil("intervals", None, -1), "number of intervals"),
        (spoil("channels", None, 7), "another robot"),
        (spoil("depth_mm", 4, np.nan), "depths that are no numbers"),
        (spoil("coefficient", (3, 1, 2), np.inf), "coefficients that are no numbers: got inf"),
        (spoil("entry_in_base", 0, np.nan), "entry"),
        (spoil("insertion_axis_in_base", None, (np.nan, 0, 0)), "insertion axis"),
        (spoil("insertion_axis_in_base", None, (0.5, 0, 0)), "unit vector: got 0.5"),
        (spoil("depth_mm", 4, 1.5), "do not increase: got 0.0"),
        (spoil("depth_mm", 30, 18.5), "depth of the array: got 18.5"),
        (spoil("depth_mm", 0, -0.5), "depth of the array: got -0.5"),
        (spoil("coefficient", (7, 0, 3), 100.0), r"jumps at depth 3.5 mm in channel 0"),
        (spoil("coefficient", (slice(0, 30), 3, 3), GOOD[0]["coefficient"][:30, 3, 3] + 2), "stylet's stroke: got 17"),
        (spoil("coefficient", (slice(0, 30), 3, 3), GOOD[0]["coefficient"][:30, 3, 3] - 1), "stylet's stroke: got -1"),
        (STYLET_BACK, "stylet back in: got -0.5"),
        (STYLET_DIP, "stylet back in: got -0.5"),
        (np.zeros(2, PATH), "not one insertion path"),
        (np.zeros(1), "not one insertion path"),
    ],
)
def test_broken_paths_are_refused_with_the_reason(path, message):
    with pytest.raises(RtctlError, match=message):
        validate_path(path, dof=3)


def test_rubbish_beyond_the_used_part_does_not_matter():
    path = spoil("coefficient", (40, 6, 0), np.nan)
    path[0]["depth_mm"][40] = np.nan
    validate_path(path, dof=3)
