"""Features of profiles with closed forms."""

import numpy as np
import pytest

from rtctl.guidance.features import GRID, REGIONS, Standard, regional, sampled


def profile(force):
    return np.stack([force, 2.0 * force, 3.0 * force])[None]


def test_the_linear_methods_see_25_samples_of_each_channel_one_channel_after_the_other():
    features = sampled(profile(GRID), 3)
    assert features.shape == (1, 75)
    assert features[0] == pytest.approx(np.concatenate([f * np.linspace(0, 1, 25) for f in (1.0, 2.0, 3.0)]))
    assert sampled(profile(GRID), 1).shape == (1, 25)


def test_a_force_that_rises_evenly_is_equally_stiff_in_all_regions():
    """-0.1 N over 13.8 mm, by 0.3 N/mm; the work of a region is the difference of the squares of its ends."""
    found = regional(profile(-0.1 * GRID))[0]
    assert found[:4] == pytest.approx(np.full(4, -0.1 / (0.3 * 13.8)))
    assert found[4:] == pytest.approx(np.diff(np.square(REGIONS)), abs=1e-4)


def test_standardised_training_features_have_mean_0_and_deviation_1():
    features = np.random.default_rng(0).normal(3.0, 7.0, (12, 5))
    phi = Standard.of(features).apply(features)
    assert phi.mean(axis=0) == pytest.approx(np.zeros(5), abs=1e-12)
    assert phi.std(axis=0, ddof=1) == pytest.approx(np.ones(5))
