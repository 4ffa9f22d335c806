"""Planar 3RPR against 01 section 1: closed forms written down once more, printed identities, differences."""

import itertools
import math

import numba
import numpy as np
import pytest

from hal.errors import OptionError
from rtctl import robots
from rtctl.robots import interface, planar_3rpr
from rtctl.robots import planar_3rpr_statics as statics
from rtctl.robots.planar_3rpr import PRINTED_HOME, Planar3rprOptions, geometry

BENT = (2.6, 2.8, 2.7)
CENTRE = np.array([162.5, 0.0, math.radians(5.5)])
GRID = np.array(
    list(
        itertools.product(
            np.linspace(155, 170, 7), np.linspace(-4, 4, 5), np.radians(np.linspace(-6, 17, 9))
        )  # the workspace W of 01 section 1.2
    )
)
PAIRS = [
    ((150, -8, -2), (0.55599187, 0.68439041, 0.80752415), (5.35989448, 6.66011481, 8.06437393)),
    ((160, 2, 5), (10.98141354, 13.25945339, 8.13509717), (112.35192477, 135.50275566, 84.37692348)),
    ((162.5, 0, 5.5), (14.12413571, 16.62269129, 9.95114242), (145.32569636, 170.69099485, 103.99805877)),
    ((158, 3.5, -4), (6.87575775, 5.62912608, 13.93269374), (65.74423518, 52.76780397, 140.22203809)),
    ((170, 4, 17), (28.83969262, 34.80218893, 15.72237609), (299.30748303, 359.79175037, 167.41430693)),
]
READINGS = {
    (8.0, -8.0, 0.0): (-6.3533, (0.01983, 0.47306, 0.14782)),
    (8.0, 0.0, -8.0): (-5.6303, (0.02027, 0.62924, 0.23590)),
    (0.0, -8.0, 8.0): (-0.3893, (0.12762, 6.9993, 1.8891)),
}
WIDE = {"box_low_mm_rad": (-300.0, -300.0, -3.2), "box_high_mm_rad": (300.0, 300.0, 3.2), "stroke_max_mm": (300.0,) * 3}


@pytest.fixture(scope="module")
def robot():
    return robots.load("planar_3rpr", {})


def degrees(x_mm, y_mm, phi_deg):
    return np.array([x_mm, y_mm, math.radians(phi_deg)])


def reading(b_y):
    return Planar3rprOptions(base_mm=tuple((0.0, y) for y in b_y))


def closed_form(options, pose):
    """q, psi and the vectors of the loop a + q s = d, straight from (III.1)-(III.3)."""
    c, s = math.cos(pose[2]), math.sin(pose[2])
    a, alpha = np.array(options.a_mm), np.array(options.alpha_rad)
    d = pose[:2] + np.array(options.platform_mm) @ np.array([[c, s], [-s, c]]) - np.array(options.base_mm)
    q = a * np.cos(alpha) + np.sqrt((a * np.cos(alpha)) ** 2 - a**2 + (d**2).sum(axis=1))
    psi = np.arctan2(d[:, 1], d[:, 0]) + np.arctan2(q * np.sin(alpha), a - q * np.cos(alpha))
    gamma = psi + alpha - math.pi
    arm, piston = np.stack([np.cos(psi), np.sin(psi)], 1), np.stack([np.cos(gamma), np.sin(gamma)], 1)
    return q, psi, a[:, None] * arm + q[:, None] * piston - d


def central(function, pose, step=1e-3):
    """Fourth-order central differences of a vector function over the pose, one column an entry."""
    columns = []
    for k in range(3):
        h = np.zeros(3)
        h[k] = step if k < 2 else step / 50
        inner, outer = function(pose + h) - function(pose - h), function(pose + 2 * h) - function(pose - 2 * h)
        columns.append((8 * inner - outer) / (12 * h[k]))
    return np.stack(columns, axis=1)


@numba.njit
def strokes_and_turns(record, pose, stroke, turn):
    planar_3rpr.strokes_and_turns(record[0], pose, stroke, turn)


@numba.njit
def forward(record, motor, pose):
    return interface.forward(record[0], motor, pose)


@numba.njit
def inverse(record, pose, joint, motor):
    return interface.inverse(record[0], pose, joint, motor)


def legs(record, pose):
    stroke, turn = np.empty(3), np.empty(3)
    strokes_and_turns(record, pose, stroke, turn)
    return stroke, turn


# --- legs and their order -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("b_y", READINGS)
def test_leg_assignment_table(b_y):
    determinant, box = READINGS[b_y]
    record, pose = geometry(reading(b_y)), np.array([165.0, 0, 0])
    assert np.linalg.det(statics.wire_jacobian(record, pose)) == pytest.approx(determinant, abs=6e-5)
    dx, dy, dphi = statics.error_box(record, pose, 0.2)
    assert (dx, dy, math.degrees(dphi)) == pytest.approx(box, abs=6e-5)


def test_printed_reading_has_the_smallest_box_of_the_six():
    pose = np.array([165.0, 0, 0])
    records = {b_y: geometry(reading(b_y)) for b_y in itertools.permutations((8.0, -8.0, 0.0))}
    across = {b_y: statics.error_box(r, pose, 0.2)[1] for b_y, r in records.items()}
    assert min(across, key=across.get) == (8.0, -8.0, 0.0)
    rest = [np.linalg.det(statics.wire_jacobian(r, pose)) for b_y, r in records.items() if b_y not in READINGS]
    assert sum(determinant > 5.0 for determinant in rest) == 2  # the third, a fan, is near zero: 0.43 mm


def assembly_angles(b_y):
    """All phi [deg] with q = 0: the tip lies on two circles, the third leg must fit (intersection of circles)."""
    options = reading(b_y)
    a, base, platform = (np.array(v) for v in (options.a_mm, options.base_mm, options.platform_mm))
    found = []
    phi = np.radians(np.linspace(-180, 180, 20001))
    rotations = np.stack([np.cos(phi), -np.sin(phi), np.sin(phi), np.cos(phi)], 1).reshape(-1, 2, 2)
    centre = base[:, None, :] - np.einsum("nij,kj->kni", rotations, platform)
    between = centre[1] - centre[0]
    length = np.hypot(*between.T)
    along = (length**2 + a[0] ** 2 - a[1] ** 2) / (2 * length)
    height = np.sqrt(np.where(np.abs(along) < a[0], a[0] ** 2 - along**2, np.nan))
    unit = between / length[:, None]
    for side in (-1, 1):
        tip = centre[0] + along[:, None] * unit + (side * height)[:, None] * np.stack([-unit[:, 1], unit[:, 0]], 1)
        misfit = np.hypot(*(tip - centre[2]).T) - a[2]
        found += list(np.degrees(phi[:-1][misfit[:-1] * misfit[1:] < 0]))
    return found


def test_assemblies_with_retracted_pistons():
    angles = {b_y: assembly_angles(b_y) for b_y in itertools.permutations((8.0, -8.0, 0.0))}
    smallest = {b_y: min(map(abs, found), default=None) for b_y, found in angles.items()}
    assert smallest[8.0, -8.0, 0.0] == pytest.approx(2.575, abs=0.02)
    assert smallest.pop((0.0, -8.0, 8.0)) is None
    assert smallest.pop((0.0, 8.0, -8.0)) is None
    assert sorted(smallest.values())[1:] == pytest.approx([3.5, 20.5, 20.5], abs=0.6)
    assert len(angles[8.0, -8.0, 0.0]) == 4


def test_another_assembly_with_retracted_pistons(robot):
    stroke, _ = robot.inverse(degrees(-26.6678, 8.7643, 159.0058))
    assert stroke == pytest.approx(np.zeros(3), abs=2e-4)


def test_home(robot):
    assert robot.home_pose == pytest.approx(PRINTED_HOME, abs=6e-7)
    stroke, motor = robot.inverse(robot.home_pose)
    assert np.abs(stroke).max() < 1e-12
    assert np.abs(motor).max() < 1e-10
    assert robot.reach(robot.home_pose) == interface.REACHABLE
    _, psi, _ = closed_form(Planar3rprOptions(), robot.home_pose)
    assert robot.record["home_arm"][0] == pytest.approx(np.stack([np.cos(psi), np.sin(psi)], 1), abs=1e-14)


# --- kinematics ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("pose", "stroke", "motor"), PAIRS)
def test_reference_pairs(robot, pose, stroke, motor):
    got_stroke, got_motor = robot.inverse(degrees(*pose))
    assert got_stroke == pytest.approx(stroke, abs=6e-9)
    assert got_motor == pytest.approx(motor, abs=6e-9)
    assert robot.forward(got_motor) == pytest.approx(degrees(*pose), abs=1e-10)


def test_forward_over_the_workspace_in_six_steps_from_home(robot):
    steps, error = [], []
    for pose in GRID:
        _, motor = robot.inverse(pose)
        found = robot.home_pose
        steps.append(forward(robot.record, motor, found))
        error.append(np.abs(found - pose).max())
    assert 1 <= min(steps) <= max(steps) <= 6
    assert max(error) <= 1e-10


@pytest.mark.parametrize("alpha", [(math.pi,) * 3, BENT, (3.5, 3.9, 2.4)])
def test_legs_close_and_agree_with_the_closed_form(alpha):
    options = Planar3rprOptions(alpha_rad=alpha)
    record = geometry(options)
    for pose in GRID[::7]:
        q, psi, gap = closed_form(options, pose)
        stroke, turn = legs(record, pose)
        assert np.abs(gap).max() < 1e-12
        assert stroke == pytest.approx(q, abs=1e-12)
        assert np.cos(turn - psi) == pytest.approx(np.ones(3), abs=1e-15)


def test_turn_is_continuous_where_an_arm_points_along_minus_x():
    """The robot mirrored on the y axis works about psi = pi; its legs must turn like those of the original."""
    data, mirrored = planar_3rpr.record(Planar3rprOptions()), planar_3rpr.record(Planar3rprOptions())
    for name in ("base_mm", "platform_mm"):
        mirrored[name][0, :, 0] *= -1
    mirrored["home_arm"][0, :, 0] *= -1
    for pose in GRID[::5]:
        stroke, turn = legs(data, pose)
        other_stroke, other_turn = legs(mirrored, pose * (-1, 1, -1))
        assert other_stroke == pytest.approx(stroke, abs=1e-12)
        assert other_turn == pytest.approx(-turn, abs=1e-14)


@pytest.mark.parametrize("motor", [(1e7, -1e7, 3.0), (math.nan, 0.0, 0.0), (0.0, math.inf, 0.0), (-1e4, -1e4, -1e4)])
def test_forward_that_fails_leaves_the_pose(robot, motor):
    pose = CENTRE.copy()
    assert forward(robot.record, np.array(motor), pose) == -1
    assert (pose == CENTRE).all()
    with pytest.raises(robots.RobotError, match="does not converge"):
        robot.forward(motor)


def test_forward_does_not_start_from_nan(robot):
    pose = np.array([160.0, math.nan, 0.0])
    assert forward(robot.record, np.zeros(3), pose) == -1
    assert pose[0] == 160.0


def test_pose_inside_the_circle_an_arm_cannot_leave_has_no_inverse():
    """With alpha = 2.6 the piston's line stays a sin(alpha) away from the base joint."""
    options = Planar3rprOptions(alpha_rad=BENT)
    record = geometry(options)
    joint, motor = np.empty(3), np.empty(3)
    assert not inverse(record, np.array([88.0 + 20.0, 0.0, 0.0]), joint, motor)
    assert np.isnan(joint).all()
    assert np.isnan(motor).all()


def test_rotation(robot):
    c, s = math.cos(0.2), math.sin(0.2)
    assert robot.rotation([160, 0, 0.2]) == pytest.approx(np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]))


# --- Jacobians ----------------------------------------------------------------------------------------------------


def test_jacobian_identities(robot):
    assert np.linalg.det(statics.wire_jacobian(robot.record, CENTRE)) == pytest.approx(-6.317152, abs=6e-7)
    expected = [[9.94878214, -2.71552146, 341.06342321], [9.86506901, -3.00472207, 546.56933102]]
    assert robot.jacobian(CENTRE)[:2] == pytest.approx(np.array(expected), abs=6e-9)


@pytest.mark.parametrize("alpha", [(math.pi,) * 3, BENT])
def test_jacobians_against_central_differences(alpha):
    """r = 0 leaves J_q; the difference to r = 1 is J_psi."""
    plain = geometry(Planar3rprOptions(alpha_rad=alpha, pulley_radius_mm=(0.0,) * 3))
    coupled = geometry(Planar3rprOptions(alpha_rad=alpha, pulley_radius_mm=(1.0,) * 3))
    for pose in (CENTRE, GRID[0], GRID[-1]):
        j_q = statics.wire_jacobian(plain, pose)
        j_psi = j_q - statics.wire_jacobian(coupled, pose)
        assert np.abs(j_q - central(lambda x: legs(plain, x)[0], pose)).max() < 5e-9
        assert np.abs(j_psi - central(lambda x: legs(plain, x)[1], pose)).max() < 2e-10


def test_printed_sign_of_j1_is_wrong():
    """J_psi = J_1 J_q + J_2 written out; the error of the printed sign is not a matter of rounding."""
    options = Planar3rprOptions(alpha_rad=BENT, pulley_radius_mm=(0.0,) * 3)
    a, base = np.array(options.a_mm)[:, None], np.array(options.base_mm)
    c, s = math.cos(CENTRE[2]), math.sin(CENTRE[2])
    e = np.array(options.platform_mm) @ np.array([[c, s], [-s, c]])
    d = CENTRE[:2] + e - base
    q, psi, _ = closed_form(options, CENTRE)
    piston = (d - a * np.stack([np.cos(psi), np.sin(psi)], 1)) / q[:, None]
    dd, across = (d**2).sum(axis=1), np.stack([-d[:, 1], d[:, 0]], 1)
    j_1 = -np.diag((across * piston).sum(axis=1) / dd)
    j_2 = np.column_stack([across, (d * e).sum(axis=1)]) / dd[:, None]
    j_q = statics.wire_jacobian(geometry(options), CENTRE)
    differences = central(lambda x: closed_form(options, x)[1], CENTRE)
    assert np.abs(j_1 @ j_q + j_2 - differences).max() < 2e-10
    assert 0.3 < np.abs(-j_1 @ j_q + j_2 - differences).max() < 0.5


# --- statics ------------------------------------------------------------------------------------------------------


def wire_stiffness(elasticity_n):
    return np.full(3, elasticity_n / 150 + elasticity_n / 220)


def test_motor_torques_do_the_work_of_the_wrench(robot):
    """Virtual work with displacements from the forward kinematics, so without any Jacobian."""
    wrench = np.array([-0.5, 0.2, 30.0])
    _, motor = robot.inverse(CENTRE)
    work = [
        wrench @ (robot.forward(motor + h, CENTRE) - robot.forward(motor - h, CENTRE)) / 0.02 for h in 0.01 * np.eye(3)
    ]
    assert statics.motor_torques(robot.record, CENTRE, wrench) == pytest.approx(work, rel=1e-6)


def test_passive_stiffness_identities(robot):
    k_p = statics.passive_stiffness(robot.record, CENTRE, wire_stiffness(3200))
    assert np.diag(k_p) == pytest.approx([101.448977, 6.260157, 162663.206662], abs=6e-7)
    assert np.linalg.inv(k_p)[1, 1] == pytest.approx(6.616988, abs=6e-7)
    stiffer = statics.passive_stiffness(robot.record, CENTRE, wire_stiffness(5000))
    assert stiffer == pytest.approx(1.5625 * k_p, rel=1e-12)


def test_pulley_radius_changes_the_stiffness():
    records = [geometry(Planar3rprOptions(pulley_radius_mm=(r,) * 3)) for r in (0.0, 1.0, 2.0, 4.0)]
    table = np.array([np.diag(statics.passive_stiffness(r, CENTRE, wire_stiffness(3200))) for r in records])
    assert table[0] == pytest.approx([102.015370, 5.620993, 155168.159], rel=1e-7)
    assert (np.diff(table, axis=0) * [-1, 1, 1] > 0).all()


def test_active_stiffness_identities(robot):
    k_a = statics.active_stiffness(robot.record, CENTRE, [-0.5, 0, 0])
    k_p = statics.passive_stiffness(robot.record, CENTRE, wire_stiffness(3200))
    assert k_a[1, 1] == pytest.approx(-0.006477, abs=6e-7)
    assert -1e-3 * k_p[2, 2] < k_a[2, 2] < 0


@pytest.mark.parametrize("alpha", [(math.pi,) * 3, BENT])
@pytest.mark.parametrize("wrench", [(-0.5, 0.0, 0.0), (0.3, -0.2, 15.0)])
def test_stiffness_is_the_hessian_of_the_wire_energy(alpha, wrench):
    """Energy sum of k (u - u_0)^2 / 2 + tau u; u and psi from the closed form, differences of its gradient."""
    options = Planar3rprOptions(alpha_rad=alpha)
    record, k = geometry(options), wire_stiffness(3200)

    def wires(x):
        q, psi, _ = closed_form(options, x)
        return q - 2.0 * psi

    forces, relaxed = statics.wire_forces(record, CENTRE, wrench), wires(CENTRE)

    def gradient(x):
        return statics.wire_jacobian(record, x).T @ (forces + k * (wires(x) - relaxed))

    assert gradient(CENTRE) == pytest.approx(wrench, abs=1e-12)
    total = statics.active_stiffness(record, CENTRE, wrench) + statics.passive_stiffness(record, CENTRE, k)
    scale = np.sqrt(np.outer(np.diag(total), np.diag(total)))
    assert np.abs((total - central(gradient, CENTRE)) / scale).max() < 2e-9


def test_error_box_is_the_vertex_maximum(robot):
    for pose in GRID[::29]:
        inverse_jacobian = np.linalg.inv(robot.jacobian(pose))
        corners = [inverse_jacobian @ (0.2 * np.array(signs)) for signs in itertools.product((-1, 1), repeat=3)]
        assert statics.error_box(robot.record, pose, 0.2) == pytest.approx(np.max(corners, axis=0), rel=1e-12)


def test_segment_tensions():
    pretension, k1, k2 = 5.0, 21.0, 14.0
    assert statics.segment_tensions(0.0, pretension, k1, k2) == (5.0, 5.0, 35.0)
    slack = pretension / k2
    before, after = (statics.segment_tensions(slack + h, pretension, k1, k2) for h in (-1e-9, 1e-9))
    assert before[0] - before[1] == pytest.approx(pretension * (1 + k1 / k2), abs=1e-6)
    assert (before[2], after[1], after[2]) == (35.0, 0.0, 21.0)
    assert statics.segment_tensions(-1.0, pretension, k1, k2) == (0.0, 19.0, 14.0)


# --- performance (01 section 1.5) ---------------------------------------------------------------------------------


def test_accuracy_of_the_workspace(robot):
    to_printed = [1, 1, math.degrees(1)]
    centre = statics.error_box(robot.record, CENTRE, 0.2) * to_printed
    assert centre == pytest.approx([0.019805, 0.469691, 0.149823], abs=6e-7)
    boxes = np.array([statics.error_box(robot.record, pose, 0.2) for pose in GRID]) * to_printed
    assert boxes.mean(axis=0) == pytest.approx([0.0245, 0.472, 0.150], abs=6e-4)
    variances = [0.04 * (np.linalg.inv(robot.jacobian(pose)) ** 2).sum(axis=1) for pose in GRID]
    rms = np.sqrt(variances) * to_printed
    assert rms.mean(axis=0) == pytest.approx([0.0172, 0.3009, 0.1032], abs=6e-5)
    assert rms.mean(axis=0)[1] / rms.mean(axis=0)[2] == pytest.approx(2.92, abs=6e-3)


def test_strokes_of_the_workspace(robot):
    strokes = np.array([robot.inverse(pose)[0] for pose in GRID])
    assert strokes.min() >= 0.54
    used = np.ptp(strokes, axis=0) / (np.array([63.2, 63.2, 64]) - 20)
    assert used == pytest.approx([0.649, 0.828, 0.608], abs=6e-4)


def test_conditioning_of_the_workspace(robot):
    scaled = [statics.wire_jacobian(robot.record, pose) @ np.diag([1, 1, 1 / 88]) for pose in GRID]
    conditions = [np.linalg.cond(m) for m in scaled]
    assert (min(conditions), max(conditions)) == pytest.approx((27.61, 38.21), abs=6e-3)
    assert max(np.linalg.det(m) for m in scaled) < 0
    assert {robot.reach(pose) for pose in GRID} == {interface.REACHABLE}


def test_singularities(robot):
    def determinant(phi_deg):
        return np.linalg.det(statics.wire_jacobian(robot.record, degrees(162.5, 0, phi_deg)))

    assert determinant(-57.0379014) * determinant(-57.0379012) < 0
    angles = np.arange(-56.5, 70.0, 0.5)
    beyond = angles[[determinant(phi) > 0 for phi in angles]]
    assert beyond[0] == pytest.approx(57.0, abs=0.5)


# --- limits, options and their errors -----------------------------------------------------------------------------


def test_default_box_holds_the_insertion_paths(robot):
    """02 section 5: x 154..170 mm, y within 5 mm, phi within 17 deg; only strokes bound it from inside."""
    poses = itertools.product(np.linspace(154, 170, 5), np.linspace(-5, 5, 5), np.radians(np.linspace(-17, 17, 5)))
    assert {robot.reach(pose) for pose in poses} <= {interface.REACHABLE, interface.STROKE_LIMIT}


def test_explain_names_the_leg_at_its_limit(robot):
    pose = [149.0, 7.0, 0.3]
    problem = robot.explain(pose)
    stroke, _ = robot.inverse(pose)
    assert robot.reach(pose) == interface.STROKE_LIMIT
    assert problem.what.startswith(robot.joint_names[int(np.argmin(stroke))])
    assert problem.value == pytest.approx(stroke.min())
    assert problem.bound == "0 .. 44 mm"


def test_explain_names_a_leg_that_cannot_be_assembled():
    """The geometry is bent after home was found: no option gives a home with one leg out of every reach."""
    robot = robots.load("planar_3rpr", WIDE)
    robot.record["alpha_cos"], robot.record["alpha_sin"] = np.cos(BENT), np.sin(BENT)
    pose = [108.0, 0.0, 0.0]
    assert robot.reach(pose) == interface.STROKE_LIMIT
    assert np.isnan(robot.explain(pose).value)
    with pytest.raises(robots.RobotError, match="no assembly"):
        robot.inverse(pose)


@pytest.mark.parametrize("phi_deg", [-57.0, -58.0, -70.0])
def test_at_and_beyond_a_singularity_is_out_of_reach(phi_deg):
    robot = robots.load("planar_3rpr", WIDE)
    pose = degrees(162.5, 0, phi_deg)
    problem = robot.explain(pose)
    assert robot.reach(pose) == interface.SINGULAR
    assert problem.value == pytest.approx(np.linalg.det(statics.wire_jacobian(robot.record, pose)))
    assert problem.bound.startswith("-1 mm")


def test_another_order_of_legs_finds_its_own_home():
    robot = robots.load("planar_3rpr", {**WIDE, "base_mm": [[0, 8], [0, 0], [0, -8]]})
    stroke, motor = robot.inverse(robot.home_pose)
    assert np.abs(stroke).max() < 1e-11
    assert np.abs(motor).max() < 1e-9
    assert abs(robot.home_pose[2] - PRINTED_HOME[2]) > 0.01


def test_symmetric_fan_has_no_home():
    with pytest.raises(robots.RobotError, match="cannot be assembled"):
        robots.load("planar_3rpr", {**WIDE, "base_mm": [[0, 0], [0, -8], [0, 8]]})


@pytest.mark.parametrize(
    "table",
    [
        {"eta_mm_per_rad": [0.097, 0.0, 0.097]},
        {"a_mm": [63.2, -63.2, 64.0]},
        {"stroke_min_mm": [0.0, 0.5, 0.0]},
        {"box_low_mm_rad": [148.5, 8.0, -0.32]},
        {"a_mm": [63.2, 20.0, 64.0]},
        {"pulley_mm": [2, 2, 2]},
    ],
)
def test_bad_options_are_refused(table):
    with pytest.raises(OptionError, match=r"robot\.geometry"):
        robots.load("planar_3rpr", table)


def test_facade_describes_the_robot(robot):
    assert (robot.kind, robot.dof, robot.length_dofs, robot.joint_units) == ("planar_3rpr", 3, 2, ("mm",) * 3)
    assert robot.pose_names == ("x_mm", "y_mm", "phi_rad")
    assert robot.translation_mask == (True, True, False)
    assert robot.record.shape == (1,)
    home = robot.home_pose
    home[:] = 0
    assert robot.home_pose[0] > 149
