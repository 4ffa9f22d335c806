"""Spec 08 section 5, item 5: the force-depth curve does not depend on the mesh."""

from dataclasses import replace

import numpy as np
import pytest

from bench.rod_insertion import Case, insert
from sim_backends.plant.options import Array

DEPTHS_MM = np.arange(1.0, 13.0, 0.25)
USUAL = Case()


@pytest.fixture(scope="module")
def usual():
    return insert(USUAL)


def with_segments(segments):
    return insert(replace(USUAL, array=replace(Array(), segments=segments), planned=Array()))


def apart(run, other):
    """Root mean square between two curves, over that of the second."""
    a, b = run.at(DEPTHS_MM), other.at(DEPTHS_MM)
    return float(np.sqrt(np.mean((a - b) ** 2) / np.mean(b**2)))


def test_more_segments_hardly_change_the_force(usual):
    coarse, fine = with_segments(24), with_segments(80)
    assert apart(usual, fine) < 0.05
    assert apart(usual, fine) < 0.5 * apart(coarse, fine)
    assert usual.mean_n == pytest.approx(fine.mean_n, rel=0.03)


def test_shorter_steps_hardly_change_the_force(usual):
    long, short = insert(replace(USUAL, step_s=2e-3)), insert(replace(USUAL, step_s=5e-4))
    assert apart(usual, short) < 0.01
    assert apart(usual, short) < 0.6 * apart(long, short)  # first order at least
    assert usual.mean_n == pytest.approx(short.mean_n, rel=0.01)


def test_nodes_that_pass_an_edge_are_not_felt():
    """Known traps of section 3: with 60 segments, a ripple of their wave length stays below 2 mN."""
    run = with_segments(60)
    edge_mm = float(run.rod["edge_mm"][0])
    d = run.motion.depth_mm
    for first in (2.0, 5.0):
        part = (d >= first) & (d < first + 10 * edge_mm)  # whole waves
        x, f = d[part], run.force_n[part]
        f = f - np.polynomial.Polynomial.fit(x, f, 9)(x)  # the curve itself
        assert 2.0 * abs(np.mean(f * np.exp(2j * np.pi * x / edge_mm))) < 2e-3
