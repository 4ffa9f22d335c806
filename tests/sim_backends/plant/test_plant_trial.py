"""One insertion out of many: bounds, repeatability, the moments of the draws, and the geometry of errors and ears."""

import json
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hal.options import read, table_of
from sim_backends.plant.backend import PlantBackend
from sim_backends.plant.options import PlantOptions
from sim_backends.plant.sensor import bear
from sim_backends.plant.trial import RUBS, TRUNCATION_SIGMA, draw, place, sample, specimen, told

SEEDS = st.integers(0, 2**63)
SIGMA = {"lateral_sd_mm": 2.0, "out_of_plane_sd_mm": 2.0, "angle_sd_rad": 0.3, "stylet_sd_mm": 2.0, "curvature_sd": 0.2, "friction_sd": 0.5}  # fmt: skip
"""The largest standard deviation of each, which is its bound."""


def options(**tables):
    return read(PlantOptions, tables)


def reads_back(drawn):
    """Bounds are what the reader checks: printed options must be options again, and the same ones."""
    return read(PlantOptions, json.loads(json.dumps(table_of(drawn)))) == drawn


trials = st.fixed_dictionaries(
    {
        "specimen": st.sampled_from(("phantom", "bone")),
        "side": st.sampled_from(("right", "left")),
        "lateral_mm": st.floats(-3, 3),
        "out_of_plane_mm": st.floats(-3, 3),
        "angle_rad": st.floats(-0.3, 0.3),
    }
)
specimens = st.fixed_dictionaries(
    {name: st.floats(0, high) for name, high in SIGMA.items()}
    | {"stylet_late_mm": st.floats(-2, 3), "friction": st.floats(0, 1), "friction_static": st.floats(0, 1.2)}
)
anatomies = st.fixed_dictionaries(
    {
        "entry_in_base_mm": st.tuples(st.floats(-1000, 1000), st.floats(-1000, 1000)),
        "insertion_angle_rad": st.floats(-3.2, 3.2),
        "out_of_plane_mm": st.floats(-3, 3),
    }
)


@given(trial=trials, table=specimens, anatomy=anatomies, offset=st.floats(-3, 3), curvature=st.floats(-0.5, 0.5), seed=SEEDS)  # fmt: skip
def test_whatever_is_drawn_is_within_the_bounds_and_prints_to_the_same_insertion(
    trial, table, anatomy, offset, curvature, seed
):
    array = {"stylet_offset_mm": offset, "curvature_error": curvature}
    given_ = options(trial=trial | {"scatter": True}, phantom=table, bone=table, anatomy=anatomy, array=array)
    sampled, drawn = sample(given_, seed), draw(given_, seed)
    assert reads_back(sampled)
    assert reads_back(drawn)
    assert not drawn.trial.scatter
    assert drawn == draw(given_, seed) == place(sampled) == draw(sampled, seed + 1) == draw(drawn, seed + 2)


@given(trial=trials, anatomy=anatomies, seed=SEEDS)
def test_without_scatter_the_seed_does_not_matter(trial, anatomy, seed):
    given_ = options(trial=trial, anatomy=anatomy)
    assert sample(given_, seed) == given_
    assert draw(given_, seed) == draw(given_, 0)


@given(anatomy=anatomies, kind=st.sampled_from(("phantom", "bone")), seed=SEEDS)
def test_without_errors_and_without_scatter_nothing_changes(anatomy, kind, seed):
    given_ = options(anatomy=anatomy, trial={"specimen": kind})
    assert draw(given_, seed) == given_


def test_scatter_of_nothing_changes_nothing():
    given_ = options(phantom=dict.fromkeys(SIGMA, 0.0), trial={"scatter": True})
    assert draw(given_, 7) == options(phantom=dict.fromkeys(SIGMA, 0.0))


@pytest.mark.parametrize("kind", ["phantom", "bone"])
def test_draws_have_the_moments_of_the_table_and_no_relation_to_each_other(kind):
    given_ = options(trial={"scatter": True, "specimen": kind})
    table = specimen(given_)
    rows = [told(sample(given_, seed)) for seed in range(1500)]
    x = np.array([list(row.values()) for row in rows])
    mean = np.array([0, 0, 0, -table.stylet_late_mm, 0, table.friction])
    sigma = np.array([table.lateral_sd_mm, table.out_of_plane_sd_mm, table.angle_sd_rad, table.stylet_sd_mm, table.curvature_sd, table.friction_sd * table.friction])  # fmt: skip
    z = (x - mean) / sigma
    assert np.abs(z).max() <= TRUNCATION_SIGMA + 1e-9
    assert np.abs(z).max() > 2.5
    assert z.mean(axis=0) == pytest.approx(np.zeros(6), abs=0.08)
    assert z.std(axis=0) == pytest.approx(np.full(6, 0.987), abs=0.05), "a normal cut off at 3 sigma"
    assert np.abs(np.corrcoef(z.T) - np.eye(6)).max() < 0.09


def test_friction_has_one_factor_for_everything_that_rubs():
    given_ = options(trial={"scatter": True, "specimen": "bone"})
    drawn = draw(given_, 5)
    factors = [getattr(drawn.bone, name) / getattr(given_.bone, name) for name in RUBS]
    assert factors == pytest.approx([factors[0]] * 3)
    assert factors[0] != 1.0
    assert drawn.phantom == given_.phantom


def test_a_draw_does_not_depend_on_the_deviation_of_another():
    less = told(sample(options(trial={"scatter": True}, phantom={"lateral_sd_mm": 0.0}), 3))
    usual = told(sample(options(trial={"scatter": True}), 3))
    assert less.pop("lateral_mm") == 0.0
    assert usual.pop("lateral_mm") != 0.0
    assert less == usual


@given(trial=trials, angle=st.floats(-3, 3))
def test_the_error_moves_the_entry_across_the_axis_and_turns_the_cochlea_about_it(trial, angle):
    given_ = options(trial=trial, anatomy={"insertion_angle_rad": angle})
    before, after = given_.anatomy, draw(given_, 0).anatomy
    moved = np.array(after.entry_in_base_mm) - before.entry_in_base_mm
    assert moved @ (math.cos(angle), math.sin(angle)) == pytest.approx(0.0, abs=1e-9)
    assert math.cos(angle) * moved[1] - math.sin(angle) * moved[0] == pytest.approx(trial["lateral_mm"], abs=1e-9)
    turn = after.insertion_angle_rad - angle - trial["angle_rad"]
    assert math.remainder(turn, math.tau) == pytest.approx(0.0, abs=1e-9)


@given(trial=trials, seed=SEEDS, scatter=st.booleans())
def test_a_left_ear_is_a_right_one_with_gravity_and_errors_across_the_plane_from_the_other_side(trial, seed, scatter):
    right, left = (draw(options(trial=trial | {"side": side, "scatter": scatter}), seed) for side in ("right", "left"))
    assert left.anatomy.entry_in_base_mm == right.anatomy.entry_in_base_mm
    assert left.anatomy.insertion_angle_rad == right.anatomy.insertion_angle_rad
    assert left.anatomy.out_of_plane_mm == -right.anatomy.out_of_plane_mm
    assert (left.array, left.phantom, left.bone) == (right.array, right.phantom, right.bone)
    x, y, z = right.sensor.gravity_direction_in_base
    assert left.sensor.gravity_direction_in_base == (x, -y, -z)
    assert left.sensor.centre_of_mass_in_sensor_mm == right.sensor.centre_of_mass_in_sensor_mm


def test_the_bench_feels_a_left_ear_as_the_weight_turned_over_and_nothing_else():
    """Weight in a room that turned about x of {B}: the sensor must read R w, with the centre of mass where it was."""
    read_by = {}
    for side in ("right", "left"):
        d = PlantBackend({"trial": {"side": side}}, period_s=0.001, seed=1).compiled().device[0]
        bear(d["sensor"], np.zeros(3), 0.4, 0.0, 0.0, 0.0)
        read_by[side] = d["sensor"]["load"].copy(), d["sensor"]["weight_in_base_n"].copy()
    (right, weight), (left, turned) = read_by["right"], read_by["left"]
    assert turned == pytest.approx(np.diag([1.0, -1.0, -1.0]) @ weight)
    c, s = math.cos(0.4), math.sin(0.4)
    into_sensor = np.array([[0, 0, 1.0], [s, -c, 0], [c, s, 0]])
    assert left[:3] == pytest.approx(into_sensor @ turned)
    assert left[3:] == pytest.approx(np.cross((3.0, -2.0, 25.0), left[:3]))
    assert not np.allclose(left, right)


def test_the_bench_is_made_of_what_was_drawn_and_tells_it():
    backend = PlantBackend({"trial": {"scatter": True, "lateral_mm": 0.5}}, period_s=0.001, seed=11)
    assert backend.options.trial.scatter
    assert backend.drawn == draw(backend.options, 11)
    anatomy = backend.compiled().device[0]["scala"]
    assert anatomy["entry_mm"] == pytest.approx(backend.drawn.anatomy.entry_in_base_mm)
    values = backend.drawn_values()
    assert values["lateral_mm"] == told(sample(backend.options, 11))["lateral_mm"]
    assert abs(values["lateral_mm"] - 0.5) <= 3 * 0.12
    printed = PlantBackend(table_of(backend.drawn), period_s=0.001, seed=11)
    assert printed.compiled().device.tobytes() == backend.compiled().device.tobytes()


def test_scatter_leaves_the_noise_of_the_sensor_alone():
    plain, scattered = (
        PlantBackend({"trial": {"scatter": s}}, period_s=0.001, seed=4).compiled().device[0] for s in (False, True)
    )
    assert plain["seed"] == scattered["seed"]
    assert plain["sensor"]["matrix"].tobytes() == scattered["sensor"]["matrix"].tobytes()
