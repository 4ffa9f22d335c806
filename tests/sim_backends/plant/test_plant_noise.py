"""The noise: normal, white, and a function of seed and tick alone."""

import numpy as np
import pytest

from sim_backends.plant.noise import normals

SEED = np.uint64(0x1234_5678_9ABC_DEF0)


def draw(ticks, seed=SEED, channels=6):
    out, rows = np.empty(channels), np.empty((len(ticks), channels))
    for i, tick in enumerate(ticks):
        normals(seed, tick, out)
        rows[i] = out
    return rows


def test_moments_are_those_of_a_standard_normal():
    x = draw(range(20_000))
    n = x.size
    assert abs(x.mean()) < 4 / np.sqrt(n)
    assert x.std() == pytest.approx(1.0, abs=4 / np.sqrt(2 * n))
    assert (x**3).mean() == pytest.approx(0.0, abs=4 * np.sqrt(15 / n))
    assert (x**4).mean() == pytest.approx(3.0, abs=4 * np.sqrt(96 / n))


def test_channels_ticks_and_neighbouring_seeds_are_uncorrelated():
    x, other = draw(range(20_000)), draw(range(20_000), SEED + np.uint64(1))
    bound = 4.5 / np.sqrt(len(x))
    between = np.corrcoef(np.hstack((x, other)).T)
    assert np.abs(between - np.eye(12)).max() < bound
    for channel in x.T:
        assert abs(np.corrcoef(channel[1:], channel[:-1])[0, 1]) < bound


def test_a_tick_has_its_noise_in_whatever_order_it_is_asked_for():
    forwards, backwards = draw([3, 1_000_000_007, 12]), draw([12, 1_000_000_007, 3])
    assert np.array_equal(forwards, backwards[::-1])
    assert not np.array_equal(forwards[0], forwards[2])
