"""CochleRob against 01 section 3: printed identities, the paper's closed forms, the potential energy, limits."""

import itertools
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hal.errors import OptionError
from rtctl import robots
from rtctl.robots import interface
from rtctl.robots.cochlerob_gravity import gravity_torques
from rtctl.robots.robot import _forward as forward

N, PULLEYS, TIP_MM = 231.0, 17.0, 230.0
AZIMUTH = np.radians([0.0, 120.0, 240.0])
ARMS = np.column_stack([np.cos(AZIMUTH), np.sin(AZIMUTH), np.zeros(3)])
DOWN = np.array([0.0, 0.0, -1.0])
TABLE = [  # P [mm], psi, phi [deg]; alpha [deg]; T_1..T_4 [uN m]
    ((0, 0, 0, 0, 0), (20.0059599855,) * 3, (-3432.736790, -3432.736790, -3432.736790, 0.0)),
    ((60, 10, -10, 30, 90), (12.0206296862, 34.5676707641, -1.5455032457), (-3192.665558, -4552.842162, -1765.242151, -895.300713)),
    ((60, 10, -10, 60, -45), (27.2440674781, 38.5554652720, 45.9904357362), (-2177.391319, -7513.434393, 5123.220057, -1026.480066)),
    ((0, 55, 20, 75, 200), (8.1192835369, -7.7835954205, -2.7165192710), (-544.812915, -4147.652562, 2943.078581, -1535.526800)),
]  # fmt: skip
WIDE = {
    "joint_low_rad": [-3.1, -3.1, -3.1, -4.0, -7.0],
    "joint_high_rad": [3.1, 3.1, 3.1, 4.0, 7.0],
    "box_low_mm_rad": [-600, -600, -600, -3.5, -6.5],
    "box_high_mm_rad": [600, 600, 600, 3.5, 6.5],
}


@pytest.fixture(scope="module")
def robot():
    return robots.load("cochlerob", {})


def degrees(row):
    return np.array([*row[:3], *np.radians(row[3:])], dtype=float)


def tilt(psi, phi):
    """A_0 = R_z(phi) R_x(psi)."""
    c, s, cp, sp = math.cos(phi), math.sin(phi), math.cos(psi), math.sin(psi)
    return np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]) @ np.array([[1, 0, 0], [0, cp, -sp], [0, sp, cp]])


def printed_delta(alpha, f_2_as_printed=False):
    """The nacelle by the paper's H_1..H_5 (01 section 3.1), the direct geometric model."""
    r, l1, l2 = 60.0, 130.0, 260.0
    ca, sa = np.cos(alpha), np.sin(alpha)
    d1, d2, d3 = -l2 * l2 + l1 * l1 + r * r + 2 * r * l1 * ca
    e1, e2, e3 = 2 * (r + l1 * ca) * ARMS[:, 0]
    f1, f2, f3 = 2 * (r + l1 * ca) * ARMS[:, 1]
    g1, g2, g3 = -2 * l1 * sa
    if f_2_as_printed:
        f2 = f3
    h1 = -(e3 - e1) * (g2 - g1) + (g3 - g1) * (e2 - e1)
    h2 = -(f3 - f1) * (e2 - e1) + (e3 - e1) * (f2 - f1)
    h3 = -(d3 - d1) * (e2 - e1) + (e3 - e1) * (d2 - d1)
    h4 = (d3 - d1) * (f2 - f1) + (f3 - f1) * (d1 - d2)
    h5 = -(g3 - g1) * (f2 - f1) - (f3 - f1) * (g1 - g2)
    a = 1 + (h5**2 + h1**2) / h2**2
    m = 2 * (h5 * h4 + h1 * h3) / h2**2 - (e1 * h5 + f1 * h1) / h2 - g1
    n = d1 + (h4**2 + h3**2) / h2**2 - (e1 * h4 + f1 * h3) / h2
    z = (-m - math.sqrt(m * m - 4 * a * n)) / (2 * a)
    return np.array([(h5 * z + h4) / h2, (h1 * z + h3) / h2, z])


def nacelle(pose):
    return tilt(*pose[3:]).T @ pose[:3] - [0, 0, TIP_MM]


def elbows(alpha):
    return (60 + 130 * np.cos(alpha))[:, None] * ARMS + 130 * np.sin(alpha)[:, None] * DOWN


def sphere(count, radius=80.0, seed=2):
    """Poses with the tip on and in the sphere of 01 section 3.3, psi 0..90 deg, any phi."""
    rng = np.random.default_rng(seed)
    direction = rng.normal(size=(count, 3))
    direction /= np.linalg.norm(direction, axis=1)[:, None]
    distance = radius * np.where(np.arange(count) % 2, 1.0, rng.uniform(size=count) ** (1 / 3))
    return np.column_stack([direction * distance[:, None], rng.uniform(0, math.pi / 2, count), rng.uniform(-math.pi, math.pi, count)])  # fmt: skip


# --- kinematics ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("alpha_deg", "expected"),
    [
        ((20, 25, 30), (15.6482651663, 9.2567705614, -243.9322674681)),
        ((0, 0, 0), (0.0, 0.0, -177.482393493)),
        ((10, 40, -5), (16.3342671439, -70.9296806021, -204.4843231572)),
    ],
)
def test_delta_identities(robot, alpha_deg, expected):
    """With slider and arc at zero the tip is 230 mm above the nacelle."""
    motor = np.append(N * np.radians(alpha_deg), [0.0, 0.0])
    assert robot.forward(motor) == pytest.approx([expected[0], expected[1], expected[2] + TIP_MM, 0, 0], abs=6e-10)
    assert printed_delta(np.radians(alpha_deg)) == pytest.approx(expected, abs=6e-10)


def test_printed_f_2_is_wrong():
    assert printed_delta(np.radians([20, 25, 30]), f_2_as_printed=True) == pytest.approx([-51.9, 94.6, 17.7], abs=0.05)


@pytest.mark.parametrize(("pose", "alpha_deg", "torque"), TABLE)
def test_table_of_joints_and_torques(robot, pose, alpha_deg, torque):
    pose = degrees(pose)
    joint, motor = robot.inverse(pose)
    assert np.degrees(joint[:3]) == pytest.approx(alpha_deg, abs=6e-11)
    assert joint[3:] == pytest.approx(pose[3:], abs=0)
    assert motor == pytest.approx(N * joint * [1, 1, 1, PULLEYS, 1], rel=1e-15)
    assert robot.forward(motor) == pytest.approx(pose, abs=1e-11)
    assert 1e6 * gravity_torques(robot.record, pose) == pytest.approx([*torque, 0.0], abs=6e-7)


def test_at_the_centre_the_delta_does_not_see_slider_and_arc(robot):
    for psi, phi in itertools.product((0.0, 0.7, 1.5), (-2.0, 0.0, 3.0)):
        assert np.degrees(robot.inverse([0, 0, 0, psi, phi])[0][:3]) == pytest.approx([20.0059599855] * 3, abs=6e-11)


def test_the_sphere_is_reachable_and_forward_inverts_inverse(robot):
    alphas = []
    for pose in sphere(4000):
        joint, motor = robot.inverse(pose)
        alphas.append(joint[:3])
        assert np.abs(robot.forward(motor) - pose).max() < 1e-11
        assert robot.reach(pose) == interface.REACHABLE
        assert printed_delta(joint[:3]) == pytest.approx(nacelle(pose), abs=1e-10)
    assert np.degrees([np.min(alphas), np.max(alphas)]) == pytest.approx([-28.3, 56.2], abs=0.3)


def test_rods_keep_their_length_and_elbows_point_outwards(robot):
    for pose in sphere(200):
        alpha = robot.inverse(pose)[0][:3]
        joints, p = elbows(alpha), nacelle(pose)
        assert np.linalg.norm(p - joints, axis=1) == pytest.approx(260.0, abs=1e-11)
        other = alpha + 2 * (
            np.arctan2(-p[2], p @ ARMS.T - 60) - alpha
        )  # mirrored at the line from the arm's axis to P_n
        assert np.linalg.norm(p - elbows(other), axis=1) == pytest.approx(260.0, abs=1e-10)
        assert (np.sum((joints - elbows(other)) * ARMS, axis=1) > 0).all()


@settings(max_examples=200, deadline=None)
@given(st.tuples(*[st.floats(-4, 4)] * 3), st.floats(-0.5, 2), st.floats(-7, 7))
def test_motor_angles_give_a_pose_with_these_motor_angles_or_none(robot, alpha, psi, phi):
    """Whatever is no assembly as drawn is refused: there `inverse` would disagree with the encoders."""
    motor, pose = N * np.array([*alpha, PULLEYS * psi, phi]), robot.home_pose
    if forward(robot.record, motor, pose) < 0:
        assert (pose == robot.home_pose).all()
    else:
        joint, again = robot.inverse(pose)
        drive = np.sum((nacelle(pose) - elbows(joint[:3])) * derivative(joint[:3]), axis=1) / (260 * 130)
        assert again == pytest.approx(motor, abs=1e-7 / max(drive.min(), 1e-7) ** 2)


def derivative(alpha):
    return -130 * np.sin(alpha)[:, None] * ARMS + 130 * np.cos(alpha)[:, None] * DOWN


@pytest.mark.parametrize("alpha_deg", [(-179, -177, -175), (20, 25, 390), (1e4, 0, 0)])
def test_elbows_inwards_and_further_turns_are_refused(robot, alpha_deg):
    with pytest.raises(robots.RobotError, match="does not converge"):
        robot.forward(np.append(N * np.radians(alpha_deg), [0, 0]))


def test_motor_angles_that_are_no_numbers_are_refused(robot):
    for k, nonsense in itertools.product(range(5), (math.nan, math.inf)):
        motor, pose = np.zeros(5), sphere(1)[0]
        motor[k], start = nonsense, pose.copy()
        assert forward(robot.record, motor, pose) == -1
        assert (pose == start).all()


def test_jacobian_against_central_differences(robot):
    """Fourth order, so that steps are large against rounding."""
    for pose in sphere(60):
        jacobian = robot.jacobian(pose)
        for k in range(5):
            h = np.zeros(5)
            h[k] = 0.02 if k < 3 else 2e-4
            inner, outer = (robot.inverse(pose + m * h)[1] - robot.inverse(pose - m * h)[1] for m in (1, 2))
            assert jacobian[:, k] == pytest.approx((8 * inner - outer) / (12 * h[k]), rel=1e-9, abs=2e-8 / h[k] * 0.02)


def test_home_has_level_arms_and_motors_at_zero(robot):
    joint, motor = robot.inverse(robot.home_pose)
    assert np.abs(joint).max() < 1e-14
    assert np.abs(motor).max() < 1e-11
    assert robot.home_pose == pytest.approx([0, 0, TIP_MM - 177.482393493, 0, 0], abs=6e-10)
    assert robot.explain(robot.home_pose) is None


def test_the_tool_advances_from_the_nacelle_to_the_tip(robot):
    for pose in sphere(20):
        rotation, a_0 = robot.rotation(pose), tilt(*pose[3:])
        nacelle_in_base = a_0 @ (nacelle(pose) + np.array([0, 0, 340]))
        assert rotation[:, 0] == pytest.approx((pose[:3] - nacelle_in_base) / 110, abs=1e-14)
        assert rotation[:, 1] == pytest.approx(a_0[:, 1], abs=1e-15)
        assert rotation[:, 2] == pytest.approx(a_0[:, 0], abs=1e-15)


# --- gravity ------------------------------------------------------------------------------------------------------


def energy(motor):
    """V [J] from the places of all masses; the nacelle from the paper's closed form."""
    alpha, psi, phi = motor[:3] / N, motor[3] / (N * PULLEYS), motor[4] / N
    joints, p, hubs = elbows(alpha), printed_delta(alpha), 60 * ARMS
    places = np.vstack([[np.zeros(3)], [p], hubs + 0.4 * (joints - hubs), 0.5 * (joints + p)]) + np.array([0, 0, 340])
    masses = np.array([0.8, 1.2, 0.12, 0.12, 0.12, 0.06, 0.06, 0.06])
    return 9.81e-3 * masses @ (places @ tilt(psi, phi).T)[:, 2]


def test_torques_are_the_slope_of_the_potential_energy(robot):
    for pose in [*sphere(60), *(degrees(row) for row, _, _ in TABLE)]:
        motor, slope = robot.inverse(pose)[1], []
        for k, step in enumerate((0.2, 0.2, 0.2, 4.0, 0.2)):
            h = np.zeros(5)
            h[k] = step
            inner, outer = (energy(motor + m * h) - energy(motor - m * h) for m in (1, 2))
            slope.append((8 * inner - outer) / (12 * step))
        assert np.abs(gravity_torques(robot.record, pose) - slope).max() < 2e-12


def test_torques_follow_the_masses(robot):
    """Each mass adds its own part: the torques are linear in them."""
    pose, none = degrees(TABLE[2][0]), {f"{name}_kg": 0.0 for name in ("arm", "rods", "nacelle", "slider")}
    alone = [robots.load("cochlerob", {**none, name: mass}) for name, mass in zip(none, (0.12, 0.06, 1.2, 0.8), strict=True)]  # fmt: skip
    parts = [gravity_torques(r.record, pose) for r in alone]
    assert np.sum(parts, axis=0) == pytest.approx(gravity_torques(robot.record, pose), rel=1e-12)
    assert np.abs(parts[3][:3]).max() == 0.0
    assert parts[3][3] == pytest.approx(-9.81e-3 * 0.8 * 340 * math.sin(math.radians(60)) / (N * PULLEYS), rel=1e-14)


def test_torques_are_unknown_where_there_is_no_assembly(robot):
    assert np.isnan(gravity_torques(robot.record, [500, 0, 0, 0.2, 0])).any()


# --- limits, options and their errors -----------------------------------------------------------------------------


@pytest.mark.parametrize("k", range(5))
def test_nan_is_nowhere(robot, k):
    pose = robot.home_pose
    pose[k] = math.nan
    assert robot.reach(pose) == interface.OUTSIDE_BOX
    assert robot.explain(pose).what.startswith(robot.pose_names[k])
    with pytest.raises(robots.RobotError, match="no assembly"):
        robot.inverse(pose)


def test_refusals_are_told_apart(robot):
    outside = robot.explain([0, 0, 0, 1.7, 0])
    assert outside.what == "psi_rad of the pose is outside the workspace box"
    assert (outside.value, outside.bound) == (1.7, "-0.02 .. 1.6 rad")
    corner = [-79.0, 0.0, -79.0, 0.0, 0.0]
    at_limit = robot.explain(corner)
    assert robot.reach(corner) == interface.STROKE_LIMIT
    assert at_limit.what.startswith("alpha1_rad")
    assert at_limit.value == pytest.approx(robot.inverse(corner)[0][0])
    assert at_limit.value > 1.1
    assert at_limit.bound == "-0.6 .. 1.1 rad"


def test_slider_and_arc_have_limits_of_their_own():
    robot = robots.load("cochlerob", {"joint_high_rad": [1.1, 1.1, 1.1, 1.0, 2.0]})
    assert robot.explain([0, 0, 0, 1.1, 0]).what.startswith("psi_rad cannot reach")
    assert robot.explain([0, 0, 0, 0.5, 2.1]).what.startswith("phi_rad cannot reach")
    assert robot.explain([0, 0, 0, 1.0, 2.0]) is None


def test_a_rod_that_is_too_short_is_a_joint_limit():
    robot = robots.load("cochlerob", WIDE)
    pose = [0.0, 0.0, TIP_MM - 400.0, 0.0, 0.0]
    assert robot.reach(pose) == interface.STROKE_LIMIT
    assert math.isnan(robot.explain(pose).value)
    with pytest.raises(robots.RobotError, match="no assembly"):
        robot.inverse(pose)


def test_outstretched_arms_are_singular():
    """Straight below, arm and rod in line: cos of their common angle is (0 - 60) / 390."""
    robot = robots.load("cochlerob", WIDE)
    lowest = -math.sqrt(390.0**2 - 60.0**2)
    pose = np.array([0.0, 0.0, TIP_MM + lowest + 0.01, 0.0, 0.0])
    problem = robot.explain(pose)
    assert robot.reach(pose) == interface.SINGULAR
    assert "in line with its rods" in problem.what
    alpha = robot.inverse(pose)[0][:3]
    drive = np.sum((nacelle(pose) - elbows(alpha)) * derivative(alpha), axis=1) / (260 * 130)
    assert problem.value == pytest.approx(drive.min(), rel=1e-6)
    assert 0 < problem.value < 0.1
    assert problem.bound == "0.1 or larger"
    assert robot.reach(pose + np.array([0, 0, 5, 0, 0])) == interface.REACHABLE


def test_rods_in_one_plane_are_singular():
    """The nacelle is above the plane of its elbows; the arms still push the rods there."""
    robot = robots.load("cochlerob", {**WIDE, "nacelle_radius_mm": 110.0, "arm_mm": 300.0, "rod_mm": 302.0})
    below, above = np.array([0.0, 0.0, TIP_MM - 150.0, 0.0, 0.0]), np.array([0.0, 0.0, TIP_MM + 60.0, 0.0, 0.0])
    assert robot.explain(below) is None
    problem = robot.explain(above)
    assert robot.reach(above) == interface.SINGULAR
    assert "in one plane" in problem.what
    assert problem.value < 0.1


def test_explain_is_silent_exactly_where_the_robot_may_go():
    robot = robots.load("cochlerob", WIDE)
    low, high = robot.record["box_low"][0], robot.record["box_high"][0]
    around = np.random.default_rng(3).uniform(1.02 * low, 1.02 * high, (2000, 5))
    answers = [(robot.reach(pose), robot.explain(pose)) for pose in around]
    assert all((answer == interface.REACHABLE) == (problem is None) for answer, problem in answers)
    assert {answer for answer, _ in answers} == {0, 1, 2, 3}


@pytest.mark.parametrize(
    "table",
    [
        {"rod_mm": 0.0},
        {"nacelle_radius_mm": 111.0},
        {"joint_low_rad": [0.1, -0.6, -0.6, -0.05, -6.3]},
        {"joint_low_rad": [0.0, 0, 0, 0, 0], "joint_high_rad": [1.1, 0.0, 1.1, 1.65, 6.3]},
        {"box_low_mm_rad": [-80, -80, -80, 1.6, -6]},
        {"box_low_mm_rad": [-80, -80, -80]},
        {"nacelle_kg": -1.0},
        {"arc_mm": 340.0},
    ],
)
def test_bad_options_are_refused(table):
    with pytest.raises(OptionError, match=r"robot\.geometry"):
        robots.load("cochlerob", table)


def test_geometries_without_a_usable_home_are_refused():
    with pytest.raises(robots.RobotError, match="cannot be assembled with its arms level"):
        robots.load("cochlerob", {"rod_mm": 180.0})
    with pytest.raises(robots.RobotError, match="home is not usable: z_mm"):
        robots.load("cochlerob", {"tool_mm": 0.0})
    with pytest.raises(robots.RobotError, match=r"home is not usable: .* singularity"):
        robots.load("cochlerob", {"rod_mm": 190.05, **WIDE})
