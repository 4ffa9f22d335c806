"""The hybrid position/force law: the vectors of 03 section 3, its bounds, and both orders."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hal.kernel import kernel
from rtctl import admittance
from rtctl.memory import parameters_dtype

OBLIQUE = np.array([1.0, 2.0, 2.0]) / 3.0
Z = np.array([0.0, 0.0, 1.0])
component = st.floats(-5.0, 5.0)
vector = st.tuples(component, component, component)


def parameters(**values):
    p = np.zeros(1, parameters_dtype(3))
    defaults = {
        "period_s": 0.001, "deadband_n": 0.03, "lateral_gain_mm_per_n_s": 50.0, "lateral_limit_mm": 5.0,
        "lateral_mask": 1.0, "blend_start_mm": 4.0, "blend_end_mm": 7.0, "stylet_gain_mm_per_n_s": 80.0,
        "regulated_force_n": -0.05,
    }  # fmt: skip
    for name, value in {**defaults, **values}.items():
        p[name] = value
    return p


@kernel
def push(p, axis, force, offset, ticks):
    length = 0.0
    for _ in range(ticks):
        length = admittance.lateral(p[0], axis, force, offset)
    return length


@kernel
def withdraw(p, axial, depth):
    return admittance.stylet_rate(p[0], axial, depth)


def offset_after(p, axis, force, ticks=1, start=(0.0, 0.0, 0.0)):
    offset = np.array(start)
    return offset, push(p, np.asarray(axis), np.asarray(force, dtype=float), offset, ticks)


def test_continuous_deadband_of_the_vector():
    force = np.array([0.02, -0.03, 0.04])
    factor = admittance.deadband(float(np.linalg.norm(force)), 0.03)
    assert factor * force == pytest.approx([0.00886, -0.01329, 0.01772], abs=5e-6)
    assert admittance.deadband(0.03, 0.03) == 0.0
    assert admittance.deadband(0.0, 0.03) == 0.0
    assert admittance.deadband(0.03 + 1e-9, 0.03) == pytest.approx(0.0, abs=1e-7), "no step at the edge"


def test_projection_of_the_deadband_of_the_vector():
    p = parameters(lateral_gain_mm_per_n_s=1000.0)  # one tick moves by the force itself
    offset, _ = offset_after(p, OBLIQUE, [0.02, -0.03, 0.04])
    assert offset == pytest.approx([0.00689, -0.01722, 0.01378], abs=5e-6)


def test_constant_force_integrates_to_the_limit_and_stays():
    p = parameters()
    offset, _ = offset_after(p, Z, [0.08, 0.0, 0.0], 1000)
    assert offset == pytest.approx([2.5, 0.0, 0.0], abs=1e-9)
    offset, reached = offset_after(p, Z, [0.08, 0.0, 0.0], 2001)
    assert offset == pytest.approx([5.0, 0.0, 0.0], abs=1e-9)
    assert reached >= 5.0
    offset, _ = offset_after(p, Z, [0.08, 0.0, 0.0], 10_000)
    assert offset == pytest.approx([5.0, 0.0, 0.0], abs=1e-9)


def test_a_saturated_correction_returns_at_once():
    p = parameters()
    offset, _ = offset_after(p, Z, [0.08, 0.0, 0.0], 20_000)
    back, reached = offset_after(p, Z, [-0.08, 0.0, 0.0], 1, offset)
    assert reached < 5.0
    assert back[0] == pytest.approx(5.0 - 0.0025)


def test_the_order_of_projection_and_deadband_matters_under_axial_force():
    axial_with_noise = [0.005, 0.0, -0.2]
    printed, _ = offset_after(parameters(project_first=0), Z, axial_with_noise)
    projected, _ = offset_after(parameters(project_first=1), Z, axial_with_noise)
    assert printed[0] > 0.0, "the axial force opens the deadband for lateral noise"
    assert not projected.any()
    strong = [0.3, 0.1, 0.0]  # without axial force there is no difference
    a, b = (offset_after(parameters(project_first=k), Z, strong)[0] for k in (0, 1))
    assert a == pytest.approx(b)


def test_directions_the_robot_lacks_stay_out():
    offset, _ = offset_after(parameters(lateral_mask=(1.0, 1.0, 0.0)), OBLIQUE, [0.3, -0.2, 0.5], 100)
    assert offset[2] == 0.0
    assert offset[0] != 0.0


@given(force=vector, axis=vector.filter(lambda v: np.linalg.norm(v) > 0.1), first=st.booleans())
def test_the_correction_never_points_along_the_axis_and_never_exceeds_the_limit(force, axis, first):
    direction = np.array(axis) / np.linalg.norm(axis)
    p = parameters(project_first=first)
    offset = np.zeros(3)
    for sign in (1.0, -1.0, 1.0):
        push(p, direction, sign * np.array(force), offset, 50)
        assert abs(offset @ direction) < 1e-9
        assert np.linalg.norm(offset) <= 5.0 + 1e-12


@given(force=vector, axis=vector.filter(lambda v: np.linalg.norm(v) > 0.1))
def test_the_gripper_gives_way_and_never_pushes_back(force, axis):
    direction = np.array(axis) / np.linalg.norm(axis)
    offset, _ = offset_after(parameters(), direction, force)
    lateral = np.array(force) - (np.array(force) @ direction) * direction
    assert offset @ lateral >= -1e-15


@pytest.mark.parametrize(
    ("depth", "axial", "rate"),
    [(3.0, -0.1, 0.0), (5.5, -0.1, 2.0), (7.0, -0.1, 4.0), (20.0, -0.1, 4.0), (4.0, -1.0, 0.0)],
)
def test_extra_stylet_withdrawal_of_the_vectors(depth, axial, rate):
    assert withdraw(parameters(), axial, depth) == pytest.approx(rate, abs=1e-12)


@given(axial=st.floats(-0.05, 5.0), depth=st.floats(0.0, 20.0))
def test_no_extra_withdrawal_without_resistance(axial, depth):
    assert withdraw(parameters(), axial, depth) == 0.0


@given(axial=st.floats(-5.0, 5.0), depth=st.floats(-5.0, 50.0))
def test_extra_withdrawal_is_never_negative(axial, depth):
    assert withdraw(parameters(), axial, depth) >= 0.0
