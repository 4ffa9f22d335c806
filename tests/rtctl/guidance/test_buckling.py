"""Buckling by two integrals: closed forms, and rates on SYN-1 by where the buckling begins (03 section 4)."""

import numpy as np
import pytest

from rtctl.guidance import buckling, synthetic
from rtctl.guidance.features import GRID


@pytest.fixture(scope="module")
def model():
    return buckling.train(synthetic.normal(51, np.random.default_rng(11)))


def test_resistance_makes_the_first_integral_grow():
    forces = np.stack([-0.2 * GRID, np.full(97, 3.0), np.full(97, -4.0)])[None]
    phi = buckling.integrals(forces)[0]
    assert phi[0] == pytest.approx(0.1 * GRID**2)
    assert phi[1] == pytest.approx(5.0 * GRID)


def test_normal_insertions_are_hardly_ever_taken_for_buckling(model):
    normal = synthetic.normal(3000, np.random.default_rng(12))
    one, two = ((buckling.detected(model, normal, sided) >= 0).mean() for sided in (False, True))
    assert one <= two <= 0.006


def test_what_buckles_early_enough_is_found(model):
    profiles, onset = synthetic.buckling(3000, np.random.default_rng(13))
    found = buckling.detected(model, profiles)
    assert (found[onset < 0.7] >= 0).all()
    assert (found[(onset > 0.7) & (onset < 0.8)] >= 0).mean() > 0.5
    assert (found[onset > 0.85] >= 0).mean() < 0.1
    late = found >= 0
    assert (GRID[found[late]] > onset[late]).mean() > 0.99, "nothing is found before it begins"


def test_few_folds_are_taken_for_buckling(model):
    folds = synthetic.folding(1000, np.random.default_rng(14))
    assert (buckling.detected(model, folds) >= 0).mean() < 0.06


def test_flags_are_latched_and_need_not_come_at_the_same_time(model):
    phi = np.broadcast_to(model.mean, (1, 2, 97))
    rates = np.gradient(phi, GRID, axis=2)
    forces = np.stack([-rates[:, 0], rates[:, 1], np.zeros((1, 97))], axis=1)
    assert buckling.detected(model, forces)[0] == -1
    pushed = forces.copy()
    pushed[0, 0, 30:33] -= 20.0
    pushed[0, 0, 33:36] += 20.0  # the force integral is back where it was
    assert buckling.detected(model, pushed)[0] == -1
    pushed[0, 1, 80:] += 200.0
    assert buckling.detected(model, pushed)[0] >= 80


def test_an_offset_the_sensor_cannot_tell_is_no_failure():
    """Training insertions that are all but equal do not make the sensor better than it is."""
    alike = synthetic.normal(1, np.random.default_rng(16)) + 1e-6 * np.random.default_rng(17).random((20, 3, 97))
    model = buckling.train(alike)
    for offset, found in ((2.9, False), (3.1, True)):
        off = alike.copy()
        off[:, 0] -= offset * 0.004
        off[:, 1:] *= (1.0 + offset * 0.1 / np.hypot(off[:, 1], off[:, 2]))[:, None]
        assert ((buckling.detected(model, off) >= 0) == found).all()


def test_low_forces_count_only_where_both_sides_do(model):
    gentle = synthetic.normal(1, np.random.default_rng(15))
    gentle[:, 0] += 1.0
    gentle[:, 1] += 100.0
    assert buckling.detected(model, gentle)[0] == -1
    assert buckling.detected(model, gentle, two_sided=True)[0] >= 0
