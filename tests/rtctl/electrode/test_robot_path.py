"""The robot path: frames and splines (spec 02 section 5), and the compiled evaluation the tick uses."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.interpolate import CubicSpline

from hal.errors import RtctlError
from rtctl.electrode import cochlea
from rtctl.electrode.path import evaluate_path
from rtctl.electrode.planning import APPROACH_RAD, plan_insertion
from rtctl.electrode.robot_path import pack, poses_in_base, robot_path
from rtctl.electrode.synthetic_arrays import modal_matrix

PLAN = plan_insertion(modal_matrix(1))
DEPTH = st.floats(0.0, 15.0)


def rotation(angle):
    return np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])


def poses_by_the_formula(plan):
    """p_B = R(-phi_C) (b(d) - b(15)) + (170, 2), phi_B = phi - phi_C."""
    pose = plan.pose_in_cochlea
    place = (pose[:, :2] - pose[-1, :2]) @ rotation(-APPROACH_RAD).T + (170.0, 2.0)
    return np.column_stack((place, pose[:, 2] - APPROACH_RAD))


def entry_of_the_formula(plan):
    offset = rotation(-APPROACH_RAD) @ (cochlea.insertion_point() - plan.pose_in_cochlea[-1, :2])
    return np.array([170.0 + offset[0], 2.0 + offset[1], 0.0])


PATH_1 = robot_path(PLAN, entry_of_the_formula(PLAN), number=7)


def at(path, depth):
    value, slope = np.full(7, np.nan), np.full(7, np.nan)
    evaluate_path(path[0], depth, value, slope)
    channels = int(path[0]["channels"])
    return value[:channels], slope[:channels]


def test_registered_entry_gives_the_formula_of_the_specification():
    assert poses_in_base(PLAN.pose_in_cochlea, entry_of_the_formula(PLAN)) == pytest.approx(poses_by_the_formula(PLAN))


@given(st.floats(-50, 200), st.floats(-50, 50), st.floats(-3, 3))
def test_another_entry_moves_the_path_as_a_rigid_body(x, y, phi):
    base, moved = poses_by_the_formula(PLAN), poses_in_base(PLAN.pose_in_cochlea, np.array([x, y, phi]))
    relative = (base[:, :2] - entry_of_the_formula(PLAN)[:2]) @ rotation(phi).T
    assert moved[:, :2] - (x, y) == pytest.approx(relative, abs=1e-9)
    assert moved[:, 2] - base[:, 2] == pytest.approx(phi)


def test_size_of_the_seven_paths():
    poses = np.concatenate([poses_by_the_formula(plan_insertion(modal_matrix(k))) for k in range(1, 8)])
    travel, lateral, _ = np.ptp(poses, axis=0)
    assert travel == pytest.approx(15.6, abs=0.05)
    assert lateral == pytest.approx(6.7, abs=0.05)
    assert np.degrees(np.abs(poses[:, 2]).max()) <= 17 + 1e-9


def test_tip_starts_at_the_entry_and_leaves_along_the_axis():
    record = PATH_1[0]
    axis = record["insertion_axis_in_base"]
    assert (record["number"], record["channels"], record["intervals"]) == (7, 4, 30)
    assert record["entry_in_base"] == pytest.approx([*entry_of_the_formula(PLAN)[:2], 0.0])
    assert np.degrees(np.arctan2(axis[1], axis[0])) == pytest.approx(12.0, abs=1e-3)
    assert np.linalg.norm(axis) == pytest.approx(1.0)


def test_path_passes_through_the_plan():
    poses = poses_by_the_formula(PLAN)
    for depth, pose, stylet in zip(PLAN.depth_mm, poses, PLAN.stylet_mm, strict=True):
        assert at(PATH_1, depth)[0] == pytest.approx([*pose, stylet], abs=1e-9)


@given(DEPTH)
def test_pose_is_the_not_a_knot_spline(depth):
    spline = CubicSpline(PLAN.depth_mm, poses_by_the_formula(PLAN))
    value, slope = at(PATH_1, depth)
    assert value[:3] == pytest.approx(spline(depth), abs=1e-9)
    assert slope[:3] == pytest.approx(spline(depth, 1), abs=1e-8)


@given(DEPTH.filter(lambda d: 0.001 < d < 14.999 and abs(d * 2 - round(d * 2)) > 1e-3))
def test_slope_agrees_with_finite_differences(depth):
    h = 1e-5
    difference = (at(PATH_1, depth + h)[0] - at(PATH_1, depth - h)[0]) / (2 * h)
    assert at(PATH_1, depth)[1] == pytest.approx(difference, abs=1e-6)


@given(DEPTH, st.floats(1e-12, 1e-6))
def test_value_and_slope_are_continuous(depth, step):
    (value, slope), (next_value, next_slope) = at(PATH_1, depth), at(PATH_1, min(depth + step, 15.0))
    assert next_value == pytest.approx(value, abs=10 * step + 1e-12)
    assert next_slope == pytest.approx(slope, abs=1e-3)


@given(DEPTH, DEPTH)
def test_stylet_never_goes_back_in(one, other):
    shallow, deep = at(PATH_1, min(one, other))[0][3], at(PATH_1, max(one, other))[0][3]
    assert 0 <= shallow <= deep + 1e-12
    assert deep <= 15 + 1e-12


@pytest.mark.parametrize(("depth", "end"), [(-2.0, 0.0), (-np.inf, 0.0), (15.1, 15.0), (np.inf, 15.0)])
def test_path_rests_outside_its_depths(depth, end):
    value, slope = at(PATH_1, depth)
    assert value == pytest.approx(at(PATH_1, end)[0])
    assert slope == pytest.approx(np.zeros(4))


def test_unknown_depth_gives_unknown_values():
    value, slope = at(PATH_1, np.nan)
    assert np.isnan(value).all()
    assert np.isnan(slope).all()


def test_six_coordinates_and_uneven_depths():
    depth = np.array([0.0, 1.0, 3.5, 4.0, 9.0])
    pose = np.random.default_rng(3).normal(size=(5, 6))
    stylet = np.array([0.0, 0.0, 4.0, 4.0, 11.0])
    path = pack(
        depth, pose, stylet, entry_in_base=np.zeros(3), insertion_axis_in_base=np.array([0.0, 0.0, 1.0]), number=1
    )
    for d, p, q in zip(depth, pose, stylet, strict=True):
        assert at(path, d)[0] == pytest.approx([*p, q])


@pytest.mark.parametrize(("knots", "dof", "message"), [(65, 3, "depths"), (3, 3, "depths"), (10, 7, "coordinates")])
def test_what_the_record_cannot_hold_is_refused(knots, dof, message):
    with pytest.raises(RtctlError, match=message):
        pack(
            np.arange(float(knots)),
            np.zeros((knots, dof)),
            np.zeros(knots),
            entry_in_base=np.zeros(3),
            insertion_axis_in_base=np.array([1.0, 0.0, 0.0]),
            number=1,
        )
