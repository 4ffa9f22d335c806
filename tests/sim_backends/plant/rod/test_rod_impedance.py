"""Spec 08 section 5, item 8, D VII.2: impedance rises as contacts near the modiolus, and tells AOS from SIT."""

from dataclasses import replace

import numpy as np
import pytest

from bench.rod_insertion import STYLET_MAX_MM, TRACE, Case, insert, run_ticks
from sim_backends.plant.backend import PlantBackend
from sim_backends.plant.bench import _look_at_contacts
from sim_backends.plant.impedance import CONTACTS, bipolar_ohm

USUAL = Case()
PULL_TICKS = 3000


def impedances_ohm(rod):
    """Of all pairs (21,) without noise or leads; NaN where a contact is not inside."""
    table = {"impedance": {"series_ohm": [0.0, 0.0], "noise_ohm": 0.0}}
    impedance = PlantBackend(table, period_s=0.001, seed=1).compiled().device[0]["impedance"]
    _look_at_contacts(impedance, rod)
    known = np.isfinite(impedance["modiolar_distance_mm"])
    pairs = [bipolar_ohm(impedance, k, k + 1) if known[k] and known[k + 1] else np.nan for k in range(CONTACTS - 1)]
    return np.array(pairs)


@pytest.fixture(scope="module")
def aos_ohm():
    return impedances_ohm(insert(USUAL).rod[0])


@pytest.fixture(scope="module")
def straight():
    """The array inserted with its stylet in it (SIT)."""
    return insert(replace(USUAL, with_stylet=False))


def test_as_many_pairs_are_inside_as_the_depth_says(aos_ohm):
    """Contacts are 0.62 mm apart from 0.6 mm behind the tip on."""
    last = int((USUAL.last_mm - 0.6) / 0.62)
    assert np.isfinite(aos_ohm[: last - 1]).all()
    assert np.isnan(aos_ohm[last + 1 :]).all()


def test_most_pairs_read_higher_after_aos_than_with_the_stylet_in(aos_ohm, straight):
    """D finds it at most contacts; the farthest of them, where D's difference is largest, do not show it here."""
    sit_ohm = impedances_ohm(straight.rod[0])
    inside = np.isfinite(sit_ohm) & np.isfinite(aos_ohm)
    assert inside.sum() >= 18
    higher = aos_ohm[inside] - sit_ohm[inside]
    assert np.mean(higher > 0.0) > 0.6
    assert higher.mean() > 200.0


def test_impedance_rises_when_the_stylet_lets_the_array_curl_towards_the_modiolus(straight):
    """What ends a SIT insertion: the gripper stands still and the stylet comes out."""
    rod, before = straight.rod.copy(), impedances_ohm(straight.rod[0])
    pose = np.repeat(straight.motion.pose[-1:], PULL_TICKS, axis=0)
    stylet_mm = np.linspace(0.0, STYLET_MAX_MM, PULL_TICKS)
    done = run_ticks(rod, straight.scala, pose, stylet_mm, straight.case.step_s, np.zeros(PULL_TICKS, TRACE))
    assert done == PULL_TICKS
    after = impedances_ohm(rod[0])
    inside = np.isfinite(before) & np.isfinite(after)
    rises = after[inside] - before[inside]
    assert np.mean(rises > 0.0) > 0.6
    assert rises.mean() > 200.0
