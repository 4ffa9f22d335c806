"""The step of the stylet: the vector of 04 section 4, finite differences, and what a stuck channel does to it."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hal.kernel import kernel
from rtctl.electrode.array_shape import bending_angle, shape_point
from rtctl.guidance.impedance import jacobian
from rtctl.guidance.impedance.layout import CONTACTS, LAW
from rtctl.guidance.impedance.power_law import impedance_of_area
from rtctl.settings import ARRAY_MATRIX

POWER = (83.2, -1.317, 1149.0)
PITCH_MM = 0.62
D_MM, G = np.array([0.20, 0.25, 0.35, 0.55]), np.array([0.10, 0.12, 0.15, 0.20])
LOWER_MM = 0.02
MATRIX = np.array(ARRAY_MATRIX)
STEP_MM = 0.185847


def law(pairs=3, pair_step=1):
    record = np.zeros(1, LAW)
    record["pair_step"], record["pairs"], record["pitch_mm"], record["step_limit_mm"] = pair_step, pairs, PITCH_MM, 1.0
    record["factor_ohm"], record["exponent"], record["far_field_ohm"] = POWER
    record["area_max_mm2"] = 0.8
    record["place_mm"] = 17.4 - PITCH_MM * np.arange(CONTACTS)
    return record


def areas(d_mm, pair_step=1):
    return 0.5 * (d_mm[:-pair_step] + d_mm[pair_step:]) * PITCH_MM


def impedances(d_mm, pair_step=1):
    return impedance_of_area(areas(d_mm, pair_step), *POWER)


@kernel
def rates(record, gain, z, found):
    for k in range(record[0].pairs):
        found[0, k] = jacobian.area_rate(gain, record[0].pitch_mm, k, record[0].pair_step)
        found[1, k] = jacobian.impedance_rate(record[0], gain, z[k], k)


@kernel
def step_of(record, gain, z, baseline, usable, gamma):
    return jacobian.stylet_step(record[0], gain, z, baseline, usable, gamma)


def step(z, baseline, gamma=1.0, usable=0b111, gain=G, record=None):
    return step_of(law(len(z)) if record is None else record, gain, z, baseline, usable, gamma)


def found_rates(record, gain, z):
    found = np.empty((2, len(z)))
    rates(record, gain, z, found)
    return found


def test_vector_of_the_specification():
    z = impedances(D_MM)
    assert areas(D_MM) == pytest.approx([0.1395, 0.186, 0.279])
    assert z == pytest.approx([2262.574, 1911.386, 1595.954], abs=5e-4)
    area_rates, impedance_rates = found_rates(law(), G, z)
    assert area_rates == pytest.approx([-0.0682, -0.0837, -0.1085], abs=1e-12)
    assert impedance_rates == pytest.approx([716.9932, 451.8279, 228.9148], abs=5e-5)
    baseline = impedances(D_MM - LOWER_MM)
    assert z - baseline == pytest.approx([-145.246, -72.518, -27.578], abs=5e-4)
    assert step(z, baseline)[0] == pytest.approx(STEP_MM, abs=5e-7)
    assert step(z, baseline, gamma=0.5)[0] == pytest.approx(STEP_MM / 2.0, abs=5e-7)
    assert step(z, baseline, gamma=0.0)[0] == 0.0
    assert step(baseline, z)[0] == 0.0, "a gain of impedance pushes nothing back"
    assert step(z, baseline)[1] == pytest.approx(np.linalg.norm(impedance_rates))


@pytest.mark.parametrize("pair_step", [1, 2])
def test_jacobian_equals_the_finite_difference(pair_step):
    """Distances shrink by g per mm of stylet."""
    z, h = impedances(D_MM, pair_step), 1e-6
    difference = (impedances(D_MM - h * G, pair_step) - impedances(D_MM + h * G, pair_step)) / (2.0 * h)
    _, found = found_rates(law(len(z), pair_step), G, z)
    assert found == pytest.approx(difference, rel=1e-7)


@kernel
def approach(record, stylet_mm, gain):
    jacobian.approach_rates(record[0].modal_matrix, stylet_mm, record[0].place_mm, gain)


@pytest.mark.parametrize("stylet_mm", [0.0, 3.0, 8.5, 14.0])
def test_contacts_near_the_modiolus_as_the_array_model_says(stylet_mm):
    record, gain, h = law(), np.empty(CONTACTS), 1e-4
    record["modal_matrix"] = MATRIX
    approach(record, stylet_mm, gain)
    for s, g in zip(record["place_mm"][0], gain, strict=True):
        ahead, behind = (np.array(shape_point(MATRIX, stylet_mm + e, s)) for e in (h, -h))
        theta = bending_angle(MATRIX, s, stylet_mm)
        normal = np.array([-np.sin(theta), np.cos(theta)])
        assert g == pytest.approx(normal @ (ahead - behind) / (2.0 * h), abs=1e-7)


def test_pulling_the_stylet_makes_every_impedance_rise():
    """The sign convention: with the normal towards the modiolus J is positive where the array curls."""
    record, gain = law(CONTACTS - 1), np.empty(CONTACTS)
    record["modal_matrix"] = MATRIX
    approach(record, 6.0, gain)
    area_rates, found = found_rates(record, gain, np.full(CONTACTS - 1, 1500.0))
    assert (area_rates[:12] < 0.0).all()
    assert (found[:12] > 0.0).all()


def test_closed_forms_of_an_array_that_is_a_circle():
    """Rolling up, theta = r q s, nears every contact; turning as a whole, theta = k s + r q, takes a far side away."""
    record, gain, stylet_mm, rate = law(), np.empty(CONTACTS), 5.0, 0.06
    s = record["place_mm"][0]
    record["modal_matrix"] = [[0, 0, 0, 0], [0, rate, 0, 0], [0, 0, 0, 0], [0, 0, 0, 0]]
    approach(record, stylet_mm, gain)
    curvature = rate * stylet_mm
    assert gain == pytest.approx(rate * (1.0 - np.cos(curvature * s)) / curvature**2)
    assert (gain > 0.0).all()
    record["modal_matrix"] = [[0, rate, 0, 0], [curvature, 0, 0, 0], [0, 0, 0, 0], [0, 0, 0, 0]]
    approach(record, stylet_mm, gain)
    assert gain == pytest.approx(rate * np.sin(curvature * s) / curvature)
    assert (gain[curvature * s > np.pi] < 0.0).all()


def test_a_stuck_channel_changes_the_step_by_a_few_per_cent():
    z, baseline = impedances(D_MM), impedances(D_MM - LOWER_MM)
    stuck, before = np.append(z, 900.0), np.append(baseline, 900.0)
    gain = np.append(G, 0.2)
    changed, _ = step(stuck, before, usable=0b1111, gain=gain, record=law(4))
    assert 0.95 * STEP_MM < changed <= STEP_MM


def test_channels_without_a_baseline_or_not_usable_do_not_count():
    z, baseline = impedances(D_MM), impedances(D_MM - LOWER_MM)
    first, _ = step(z, baseline, usable=0b001)
    unknown = baseline.copy()
    unknown[1:] = np.nan
    assert step(z, unknown)[0] == first
    with_nan = z.copy()
    with_nan[1:] = np.nan
    assert step(with_nan, baseline, usable=0b001)[0] == first
    assert step(z, np.full(3, np.nan)) == (0.0, 0.0)
    assert step(z, baseline, usable=0) == (0.0, 0.0)


def test_what_cannot_be_computed_is_nan_and_never_a_step():
    z, baseline = impedances(D_MM), impedances(D_MM - LOWER_MM)
    broken = G.copy()
    broken[0] = np.nan
    assert np.isnan(step(z, baseline, gain=broken)).all()


impedance = st.floats(-2000.0, 3e4)


@given(
    z=st.tuples(*[impedance] * 3), before=st.tuples(*[impedance] * 3), gain=st.tuples(*[st.floats(-1.0, 1.0)] * 4),
    gamma=st.floats(0.0, 1.0),
)  # fmt: skip
def test_the_step_is_always_between_nothing_and_its_limit(z, before, gain, gamma):
    found, size = step(np.array(z), np.array(before), gamma, gain=np.array(gain))
    assert 0.0 <= found <= 1.0
    assert size >= 0.0


@given(drop=st.floats(1.0, 40.0))
def test_a_small_drop_is_given_back(drop):
    """Where the model holds, the step restores what was lost: J delta q = -delta z along J."""
    z = impedances(D_MM)
    _, found = found_rates(law(), G, z)
    lost_mm = drop / np.linalg.norm(found)
    assert step(z, z + found * lost_mm)[0] == pytest.approx(min(lost_mm, 1.0))
