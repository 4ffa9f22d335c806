"""What the pictures are drawn from: the reference forces and the place of the cochlea."""

import math

import numpy as np
import pytest

from rtctl.electrode import cochlea
from rtctl.electrode.planning import APPROACH_RAD
from rtctl.electrode.robot_path import poses_in_base
from rtctl.guidance.force_model import FULL_DEPTH_MM, resistance
from rtctl.report.scala import Placement


def test_reference_forces_have_the_values_of_the_specification():
    mean, deviation = resistance(FULL_DEPTH_MM * np.linspace(0, 1, 6))
    assert -mean == pytest.approx([-0.00368, -0.01943, -0.05576, -0.04169, -0.04532, -0.09988], abs=5e-6)
    assert deviation == pytest.approx([0.00754, 0.01376, 0.02151, 0.01796, 0.03973, 0.11535], abs=5e-6)


@pytest.mark.parametrize("entry", [(172.0, 4.0, 0.0), (165.0, -3.0, 0.3)])
def test_registered_cochlea_lies_where_the_planner_puts_it(entry):
    place = Placement.of_registration(np.array(entry))
    assert place.to_base(cochlea.insertion_point()[None])[0] == pytest.approx(entry[:2])
    path = cochlea.insertion_path().points(np.array([1.0, 5.0, 9.0]))
    poses = np.column_stack((path, np.full(3, APPROACH_RAD)))
    assert place.to_base(path) == pytest.approx(poses_in_base(poses, np.array(entry))[:, :2])


def test_insertion_direction_is_twelve_degrees_from_the_registered_gripper():
    place = Placement.of_registration(np.array([170.0, 0.0, 0.1]))
    start, end = place.to_base(cochlea.insertion_path().vertices[:2])
    bearing = math.atan2(end[1] - start[1], end[0] - start[0])
    assert bearing - 0.1 == pytest.approx(math.radians(12.0), abs=1e-3)
