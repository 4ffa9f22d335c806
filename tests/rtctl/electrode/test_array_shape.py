"""The modal shape model against the identities of spec 02 section 2 and independent quadrature."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rtctl.electrode.array_shape import (
    bending_angle,
    shape_point,
    shape_points,
    shape_points_and_jacobians,
    stylet_jacobian,
    tip,
)
from rtctl.electrode.synthetic_arrays import modal_matrix

A1 = modal_matrix(1)


def position_by_24_point_quadrature(modal, q, s):
    nodes, weights = np.polynomial.legendre.leggauss(24)
    tau = s * (nodes + 1) / 2
    angle = np.vander(tau, 4, increasing=True) @ modal @ q ** np.arange(4.0)
    return s / 2 * np.array([weights @ np.cos(angle), weights @ np.sin(angle)])


@pytest.mark.parametrize(
    ("q", "points"),
    [
        (0.0, [(5.994826, 0.211501), (11.949743, 0.931986), (17.872347, 1.891724)]),
        (15.0, [(5.938307, 0.662005), (8.953264, 5.096458), (6.773840, 3.862527)]),
    ],
)
def test_points_of_array_1(q, points):
    found = np.empty((3, 2))
    shape_points(A1, q, np.array([6.0, 12.0, 18.0]), found)
    assert found == pytest.approx(np.array(points), abs=1e-6)


def test_stylet_jacobian_at_the_tip_of_array_1():
    assert stylet_jacobian(A1, 15.0, 18.0) == pytest.approx((-0.3873631032, 0.1508320040), abs=1e-9)


@settings(max_examples=50)
@given(st.integers(1, 7), st.floats(0, 15), st.floats(0.01, 18))
def test_position_agrees_with_independent_quadrature(number, q, s):
    modal = modal_matrix(number)
    assert shape_point(modal, q, s) == pytest.approx(position_by_24_point_quadrature(modal, q, s), abs=1e-9)


@settings(max_examples=50)
@given(st.integers(1, 7), st.floats(0.1, 14.9), st.floats(0, 18))
def test_stylet_jacobian_agrees_with_finite_differences(number, q, s):
    modal, h = modal_matrix(number), 1e-5
    after, before = np.array(shape_point(modal, q + h, s)), np.array(shape_point(modal, q - h, s))
    assert stylet_jacobian(modal, q, s) == pytest.approx((after - before) / (2 * h), abs=1e-8)


@settings(max_examples=25)
@given(st.floats(0, 15), st.lists(st.floats(0, 18), min_size=1, max_size=8).map(sorted))
def test_many_nodes_agree_with_each_node_alone(q, nodes):
    points, with_jacobian, jacobians = (np.empty((len(nodes), 2)) for _ in range(3))
    shape_points(A1, q, np.array(nodes), points)
    shape_points_and_jacobians(A1, q, np.array(nodes), with_jacobian, jacobians)
    alone = np.array([shape_point(A1, q, s) for s in nodes])
    assert points == pytest.approx(alone, abs=1e-10)
    assert with_jacobian == pytest.approx(alone, abs=1e-10)
    assert jacobians == pytest.approx(np.array([stylet_jacobian(A1, q, s) for s in nodes]), abs=1e-10)


def test_tip_is_the_point_at_full_length_and_the_angle_its_tangent():
    assert tip(A1, 7.0) == shape_point(A1, 7.0, 18.0)
    chord = np.subtract(shape_point(A1, 7.0, 9.0 + 1e-5), shape_point(A1, 7.0, 9.0 - 1e-5))
    assert np.arctan2(chord[1], chord[0]) == pytest.approx(bending_angle(A1, 9.0, 7.0), abs=1e-8)
