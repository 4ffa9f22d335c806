"""Calibration of the modal matrix (spec 02 section 3) and the synthetic arrays it is tried on (section 2)."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from hal.errors import RtctlError
from rtctl.electrode.array_shape import bending_angle
from rtctl.electrode.calibration import calibrate
from rtctl.electrode.synthetic_arrays import (
    S_SAMPLES_MM,
    STYLET_SAMPLES_MM,
    SYNTHETIC_ARRAYS,
    mean_modal_matrix,
    modal_matrix,
)

A1_OF_SPEC = np.array(
    [
        [2.93695392269587e-03, -3.94085203728490e-02, 6.16973009198033e-03, -2.35843234791911e-04],
        [6.26946771319700e-03, 4.90351444182624e-02, -7.18756027501557e-03, 2.64267314493850e-04],
        [1.47679960554564e-03, -1.03290097336955e-02, 1.34216948322671e-03, -4.39002771123580e-05],
        [-7.77889138080976e-05, 5.33535053874115e-04, -5.34787115835697e-05, 1.50893500682453e-06],
    ]
)
ROW_SCALE, COLUMN_SCALE = 18.0 ** -np.arange(4.0), 15.0 ** -np.arange(4.0)


def angles_of(modal, s, q):
    return np.vander(s, 4, increasing=True) @ modal @ np.vander(q, 4, increasing=True).T


def test_samples_are_those_of_the_specification():
    assert S_SAMPLES_MM[[0, 1, 22, 23]] == pytest.approx([0, 18 / 23, 18 * 22 / 23, 18])
    assert STYLET_SAMPLES_MM[[0, 1, 11, 12]] == pytest.approx([0, 1.27, 13.97, 15])


def test_matrix_of_array_1():
    assert modal_matrix(1) == pytest.approx(A1_OF_SPEC, rel=1e-9)


def test_residual_of_array_1():
    measured = SYNTHETIC_ARRAYS[0].angle_rad(S_SAMPLES_MM, STYLET_SAMPLES_MM)
    residual = measured - angles_of(modal_matrix(1), S_SAMPLES_MM, STYLET_SAMPLES_MM)
    assert np.sqrt(np.mean(residual**2)) == pytest.approx(0.02731, abs=1e-5)


@pytest.mark.parametrize(
    ("number", "straight", "curled"),
    [(1, 0.140605, 6.165269), (3, 0.277497, 6.765062), (5, 0.311327, 6.510350), (7, 0.008091, 6.929328)],
)
def test_tip_angles(number, straight, curled):
    modal = modal_matrix(number)
    assert bending_angle(modal, 18.0, 0.0) == pytest.approx(straight, abs=1e-6)
    assert bending_angle(modal, 18.0, 15.0) == pytest.approx(curled, abs=1e-6)


@settings(max_examples=25)
@given(arrays(float, (4, 4), elements=st.floats(-3, 3)))
def test_exact_modal_data_return_the_matrix(scaled):
    modal = scaled * np.outer(ROW_SCALE, COLUMN_SCALE)
    found = calibrate(S_SAMPLES_MM, STYLET_SAMPLES_MM, angles_of(modal, S_SAMPLES_MM, STYLET_SAMPLES_MM))
    error = (found - modal) / np.outer(ROW_SCALE, COLUMN_SCALE)
    assert np.linalg.norm(error) <= 1e-11 * max(np.linalg.norm(scaled), 1e-3)


def test_held_array_has_its_held_curvature_everywhere():
    array = SYNTHETIC_ARRAYS[4]
    assert array.angle_rad(S_SAMPLES_MM, np.zeros(1))[:, 0] == pytest.approx(0.03 + 0.02 * S_SAMPLES_MM)


def test_mean_matrix_bends_by_the_mean_angle():
    mean = np.mean([bending_angle(modal_matrix(k), 14.0, 9.0) for k in range(1, 8)])
    assert bending_angle(mean_modal_matrix(), 14.0, 9.0) == pytest.approx(mean)


def test_a_caller_cannot_spoil_the_shipped_matrices():
    modal_matrix(1)[:] = 0.0
    assert modal_matrix(1) == pytest.approx(A1_OF_SPEC, rel=1e-9)


@pytest.mark.parametrize("number", [0, 8])
def test_unknown_array(number):
    with pytest.raises(ValueError, match="1 to 7"):
        modal_matrix(number)


@pytest.mark.parametrize(
    ("s", "q", "angle", "message"),
    [
        (np.arange(5), np.arange(6), np.zeros((6, 5)), "do not match"),
        (np.arange(5), np.arange(6), np.full((5, 6), np.nan), "finite"),
        (np.arange(3), np.arange(6), np.zeros((3, 6)), "arc lengths"),
        (np.arange(5), [0, 1, 2, 2], np.zeros((5, 4)), "stylet"),
    ],
)
def test_useless_samples_are_refused(s, q, angle, message):
    with pytest.raises(RtctlError, match=message):
        calibrate(s, q, angle)
