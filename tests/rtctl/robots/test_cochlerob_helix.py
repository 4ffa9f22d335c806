"""The cochlear helix of CochleRob and the motion along it against 01 section 3.6."""

import math

import numpy as np
import pytest

from hal.errors import OptionError
from rtctl import robots
from rtctl.robots import interface
from rtctl.robots.cochlerob_helix import Helix, HelixMotion

GRID_S = np.arange(0.0, 125.0 + 1e-9, 0.02)


@pytest.fixture(scope="module")
def robot():
    return robots.load("cochlerob", {})


@pytest.fixture(scope="module")
def motion():
    return HelixMotion(Helix())


def printed_point(u):
    """p(u) as the specification writes it."""
    n = np.array([math.sin(math.radians(40)), math.cos(math.radians(40)), 0.0])
    e_1 = np.array([0.0, 0.0, 1.0])
    end, a = math.radians(900), u + math.radians(30)
    k = math.log(3.5 / 1.0) / end
    circle = math.cos(a) * e_1 + math.sin(a) * np.cross(n, e_1)
    return np.array([60, 10, -10]) + 3.5 * math.exp(-k * u) * circle + 4 * u / end * n


def test_curve_and_its_derivatives():
    u, h = np.linspace(0.0, Helix().end_rad, 40), 1e-3
    p, first, second = Helix().derivatives(u)
    assert p == pytest.approx(np.array([printed_point(x) for x in u]), abs=1e-13)
    before, after = (np.array([printed_point(x + s * h) for x in u]) for s in (-1, 1))
    assert first == pytest.approx((after - before) / (2 * h), abs=1e-6)
    assert second == pytest.approx((after - 2 * p + before) / h**2, abs=1e-6)


def test_arc_length():
    assert Helix().arc_length_mm == pytest.approx(31.7336, abs=6e-5)
    other = Helix(turns=1.3, height_mm=9.0, base_radius_mm=8.0, apex_radius_mm=2.0)
    p, _, _ = other.derivatives(np.linspace(0.0, other.end_rad, 20001))
    assert other.arc_length_mm == pytest.approx(np.linalg.norm(np.diff(p, axis=0), axis=1).sum(), rel=1e-7)


def test_half_turns_are_where_the_tangent_is_horizontal():
    helix = Helix()
    u = helix.half_turns_rad()
    assert np.degrees(u) == pytest.approx([145.44012 + 180 * i for i in range(5)], abs=6e-6)
    assert np.abs(helix.derivatives(u)[1][:, 2]).max() < 1e-14
    fine = np.linspace(0.0, helix.end_rad, 10001)
    assert np.sum(np.diff(np.sign(helix.derivatives(fine)[1][:, 2])) != 0) == len(u)
    assert len(Helix(turns=0.3).half_turns_rad()) == 0
    assert np.degrees(Helix(phase_rad=math.radians(-30)).half_turns_rad()[0]) == pytest.approx(25.44012, abs=6e-6)


def test_spot_values_at_90_degrees(robot, motion):
    """u grows in the first phase, so the time at which it is 90 deg is found by halving."""
    first = motion.phases[0]
    low, high = first.start_s, first.start_s + first.duration_s
    target = Helix().derivatives([math.radians(90)])[0][0]
    for _ in range(60):
        middle = 0.5 * (low + high)
        ahead = motion.pose(middle)[0][0, :3] - target
        low, high = (low, middle) if ahead @ Helix().derivatives([math.radians(90)])[1][0] > 0 else (middle, high)
    pose = motion.pose(low)[0][0]
    assert pose[:3] == pytest.approx([62.305662, 8.587483, -11.543943], abs=6e-7)
    assert np.degrees(pose[3:]) == pytest.approx([34.838535, 41.754364], abs=1e-6)
    tangent = np.array([-0.380428, 0.426168, -0.820765])
    assert robot.rotation(pose)[:, 0] == pytest.approx(tangent, abs=1e-6)  # downwards, so A_0 z is -t
    assert np.degrees(robot.inverse(pose)[0][:3]) == pytest.approx([0.795141, 38.570048, 18.549319], abs=1e-6)


def test_rates_are_the_slope_of_the_pose(motion):
    t, h = GRID_S[1:-1], 1e-4
    _, rate = motion.pose(t)
    assert rate == pytest.approx((motion.pose(t + h)[0] - motion.pose(t - h)[0]) / (2 * h), abs=3e-6)
    assert np.abs(rate).max() > 3.0


def test_tool_axis_is_tangential_all_the_way(robot, motion):
    poses, rates = motion.pose(GRID_S)
    moving = np.linalg.norm(rates[:, :3], axis=1) > 1e-3
    for pose, rate in zip(poses[moving], rates[moving], strict=True):
        direction = rate[:3] / np.linalg.norm(rate[:3])
        assert abs(robot.rotation(pose)[:, 0] @ direction) == pytest.approx(1.0, abs=1e-12)
    assert np.degrees(poses[:, 3]).min() == pytest.approx(4.480, abs=1e-3)
    assert np.degrees(poses[:, 3]).max() == pytest.approx(90.0, abs=1e-9)


def test_half_turns_rest_at_their_point_and_phi_never_jumps(motion):
    assert motion.duration_s == pytest.approx(125.0, abs=1e-9)
    halves = [phase for phase in motion.phases if phase.turn_rad]
    assert [phase.duration_s for phase in halves] == [5.0] * 5
    assert {abs(phase.turn_rad) for phase in halves} == {math.pi}
    for phase in halves:
        poses, _ = motion.pose(phase.start_s + np.linspace(0, phase.duration_s, 50, endpoint=False))
        assert np.ptp(poses[:, :3], axis=0).max() == 0.0
        assert poses[:, 3] == pytest.approx(math.pi / 2, abs=1e-12)
    seams = np.array([phase.start_s for phase in motion.phases[1:]])
    before, after = motion.pose(seams - 1e-7), motion.pose(seams)
    assert after[0] == pytest.approx(before[0], abs=1e-10)
    assert np.abs(after[1]).max() < 1e-10


def test_of_two_half_turns_the_one_nearer_to_zero(motion):
    """phi of the following phase the other way round would be farther from 0, whatever is chosen afterwards."""
    along = [phase for phase in motion.phases if not phase.turn_rad]
    for phase in along[1:]:
        ends = motion.pose([phase.start_s, phase.start_s + phase.duration_s - 1e-9])[0][:, 4]
        half = next(h for h in motion.phases if h.start_s + h.duration_s == phase.start_s)
        other_way = ends.mean() - 2 * half.turn_rad
        assert abs(ends.mean()) <= abs(other_way)


def test_at_rest_before_and_after(motion):
    for outside, end in ((-1.0, 0.0), (126.0, 125.0)):
        pose, rate = motion.pose(outside)
        assert pose == pytest.approx(motion.pose(end)[0], abs=0)
        assert np.abs(rate).max() == 0.0


def test_motor_speeds_of_the_specification(robot, motion):
    t = np.concatenate([GRID_S, *(p.start_s + p.duration_s / 2 + np.linspace(-0.1, 0.1, 41) for p in motion.phases)])
    poses, rates = motion.pose(t)
    assert {robot.reach(pose) for pose in poses} == {interface.REACHABLE}
    speeds = [robot.jacobian(pose) @ rate for pose, rate in zip(poses, rates, strict=True)]
    delta_1, delta_2, delta_3, slider, arc = np.abs(speeds).max(axis=0)
    assert max(delta_1, delta_2, delta_3) < 300
    assert slider == pytest.approx(1130, abs=0.5)
    assert arc == pytest.approx(840, abs=0.5)


@pytest.mark.parametrize("apex", [3.5, 4.0])
def test_a_helix_that_does_not_become_narrower_is_refused(apex):
    with pytest.raises(OptionError, match="apex_radius_mm"):
        Helix(apex_radius_mm=apex)


@pytest.mark.parametrize("durations", [{"turn_s": 0.0}, {"half_turn_s": -1.0}, {"turn_s": math.nan}])
def test_durations_that_are_none_are_refused(durations):
    with pytest.raises(OptionError, match="not a duration"):
        HelixMotion(Helix(), **durations)
