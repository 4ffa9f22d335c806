"""Algorithm 1 against the printed numbers (03 section 2), and the tick's way of computing it against its definition."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from rtctl.guidance import prediction
from rtctl.guidance.force_model import REFERENCE, ForceModel, basis
from rtctl.guidance.prediction import LENGTH, fuse, predict, rate_deviation, tabulate

X = np.linspace(0.0, 1.0, 101)
SHOWN = [50, 60, 70, 80, 90, 100]
F_Z = ForceModel(REFERENCE.mean[:1], REFERENCE.deviation[:1], REFERENCE.floor[:1])


def insertion():
    mean, deviation = F_Z.mean @ basis(X).T, F_Z.deviation @ basis(X).T
    return mean + 0.8 * deviation * np.sin(5.0 * X + 0.3)


def whole(known):
    return predict(F_Z, X, insertion()[:, :known]) @ basis(X).T


def rms(values):
    return float(np.sqrt(np.mean(np.square(values))))


def test_the_printed_insertion_is_predicted_as_printed():
    truth = [-0.04507, -0.04396, -0.05319, -0.07444, -0.10642, -0.17668]
    predicted = [-0.04532, -0.04474, -0.04419, -0.04761, -0.05749, -0.07081]
    fused = [-0.04642, -0.04409, -0.04418, -0.04847, -0.05617, -0.06706]
    assert insertion()[0, SHOWN] == pytest.approx(truth, abs=5.1e-6)
    assert whole(41)[0, SHOWN] == pytest.approx(predicted, abs=1e-5)
    expected, _ = fuse(F_Z, X, insertion()[:, :41])
    assert expected[0, np.array(SHOWN) - 41] == pytest.approx(fused, abs=1e-5)


def test_it_beats_the_mean_of_all_insertions_where_the_specification_says_so():
    mean = F_Z.mean @ basis(X).T
    future = rms((insertion() - whole(41))[:, 41:]), rms((insertion() - mean)[:, 41:])
    assert future == pytest.approx((0.0379, 0.0328), abs=2e-4)
    assert 2.0 * rms((insertion() - whole(21))[:, 21:]) < rms((insertion() - mean)[:, 21:])


def test_the_extrapolation_is_trusted_over_the_next_millimetres():
    assert LENGTH == 0.2
    assert rate_deviation(F_Z, np.array([0.4]))[0, 0] == pytest.approx(0.10757, abs=5e-6)


def test_with_everything_known_it_is_the_plain_fit():
    plain = np.linalg.lstsq(basis(X), insertion()[0], rcond=None)[0]
    assert predict(F_Z, X, insertion())[0] == pytest.approx(plain, abs=1e-9)


def test_a_point_ten_times_less_certain_counts_less():
    """The proof of 03 section 2: the last 20 samples, ten times less certain, are shifted by 0.1 N."""
    late = np.arange(101) >= 81
    moved = {}
    for name, deviation in (("variance", np.where(late, 10.0, 1.0)), ("as printed", np.where(late, 0.1, 1.0))):
        rows = basis(X) / deviation[:, None]
        moved[name] = basis(np.array([0.75])) @ np.linalg.lstsq(rows, 0.1 * late / deviation, rcond=None)[0]
    assert moved["variance"][0] == pytest.approx(-0.0012, abs=2e-4)
    assert moved["as printed"][0] > 0.05


def follow(tables, forces):
    """The fitted curves (m, channels, m) after each sample, as the tick computes them."""
    channels, samples = forces.shape
    sums: np.ndarray = np.zeros(1, prediction.sums_dtype(channels))
    prediction.start(sums[0])
    curves = np.zeros((samples, channels, samples))
    for k in range(samples):
        for c in range(channels):
            prediction.know(tables[0], sums[0], k, c, forces[c, k])
            prediction.forecast(tables[0], sums[0], k + 1, c)
            curves[k, c] = [prediction.evaluate(tables[0], sums[0], i, c) for i in range(samples)]
    return curves


@pytest.fixture(scope="module")
def tables():
    return tabulate(REFERENCE, np.linspace(0.0, 1.0, 97))


@settings(max_examples=8, deadline=None)
@given(
    arrays(float, (3, 97), elements=st.floats(-1.0, 1.0)),
    st.floats(0.01, 20.0),
)
def test_the_tick_s_way_is_the_definition_whatever_is_measured(tables, shape, scale):
    x, forces = np.linspace(0.0, 1.0, 97), scale * shape
    curves = follow(tables, forces)
    rows = basis(x)
    for k in range(1, 98):
        wanted = predict(REFERENCE, x, forces[:, :k]) @ rows.T
        assert curves[k - 1] == pytest.approx(wanted, abs=1e-9 * max(scale, 1.0))


def test_the_tick_s_way_gives_the_printed_insertion_too():
    curves = follow(tabulate(F_Z, X), insertion())
    assert curves[40] == pytest.approx(whole(41), abs=1e-9)
