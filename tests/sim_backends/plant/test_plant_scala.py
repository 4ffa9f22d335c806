"""The specimen's walls are those of the template, wherever it lies and however large it is."""

import math

import numpy as np
import pytest

from rtctl.electrode import cochlea
from sim_backends.plant import scala
from sim_backends.plant.options import Anatomy, Phantom
from sim_backends.plant.rod.state import POSTS
from sim_backends.plant.scala import SCALA, WALL_POINTS, wall_at


def packed(**anatomy):
    record = np.zeros(1, SCALA)
    scala.pack(Anatomy(**anatomy), Phantom(), record[0])
    return record[0]


@pytest.mark.parametrize("size", [3.4, 3.84, 4.3])
def test_the_walls_are_those_of_the_template_scaled_about_the_entry(size):
    record = packed(entry_in_base_mm=(0.0, 0.0), insertion_angle_rad=0.0, spiral_a_mm=size)
    scale, turn = size / 3.84, -cochlea.insertion_path().direction_rad
    rotation = scale * np.array([[math.cos(turn), -math.sin(turn)], [math.sin(turn), math.cos(turn)]])
    angles = np.arange(10.3, 700.0, 0.01)
    lateral = (cochlea.lateral_wall(angles) - cochlea.insertion_point()) @ rotation.T
    modiolar = (cochlea.modiolar_wall(angles) - cochlea.insertion_point()) @ rotation.T
    kink = np.linalg.norm(lateral - lateral[np.argmin(abs(angles - 100.0))], axis=1)
    for arc in scale * np.arange(0.5, 28.0, 0.37):
        x, y, tx, ty, _, width, _ = wall_at(record, arc)
        assert math.hypot(tx, ty) == pytest.approx(1.0, abs=1e-12)
        near = np.linalg.norm(lateral - (x, y), axis=1)
        assert near.min() < 0.012 * scale
        if kink[near.argmin()] > 0.5 * scale:
            assert near.min() < 0.002 * scale
            assert np.linalg.norm(modiolar - (x - width * ty, y + width * tx), axis=1).min() < 0.02 * scale
    assert record["arc_step_mm"] * (WALL_POINTS - 1) > scale * (20.8924 + 5)  # beyond the first turn by a second half


def test_position_tangent_and_curvature_of_the_wall_belong_together():
    record, h = packed(), 1e-3
    for arc in np.arange(6.0, 27.0, 0.173):  # the kink lies before
        x0, y0, tx0, ty0, *_ = wall_at(record, arc - h)
        x1, y1, tx1, ty1, *_ = wall_at(record, arc + h)
        _, _, tx, ty, curvature, _, slope = wall_at(record, arc)
        assert ((x1 - x0) * tx + (y1 - y0) * ty) / (2 * h) == pytest.approx(1.0, abs=0.01)
        assert ((y1 - y0) * tx - (x1 - x0) * ty) / (2 * h) == pytest.approx(0.0, abs=0.01)
        assert (tx0 * ty1 - ty0 * tx1) / (2 * h) == pytest.approx(curvature, abs=0.03)
        assert abs(slope) < 0.2


def test_lips_leave_the_hole_free_and_are_flush_with_the_bone():
    record = packed(entry_in_base_mm=(10.0, 20.0), insertion_angle_rad=0.3)
    axis = record["axis"]
    left = np.array([-axis[1], axis[0]])
    for post, side in ((scala.LEFT_LIP, 1.0), (scala.RIGHT_LIP, -1.0)):
        place = record["post_mm"][post] - record["entry_mm"]
        radius = record["post_radius_mm"][post]
        assert side * (place @ left) - radius == pytest.approx(record["hole_radius_mm"])
        assert place @ axis == pytest.approx(radius)
        assert record["post_normal"][post] == pytest.approx(-side * left)
    assert POSTS == 4


def test_the_recess_is_where_its_cone_is_as_wide():
    record = packed(recess_angle_rad=0.25, recess_clearance_mm=1.6)
    posts = record["post_mm"][scala.LEFT_RECESS :]
    gap = np.linalg.norm(posts[0] - posts[1]) - record["post_radius_mm"][scala.LEFT_RECESS :].sum()
    assert gap == pytest.approx(2 * 1.6)
    window = posts.mean(axis=0) - record["entry_mm"]
    assert np.linalg.norm(window) == pytest.approx(1.6 / math.tan(0.25))
    bearing = math.atan2(*(-window)[::-1])
    assert record["axis"] @ (math.cos(bearing), math.sin(bearing)) == pytest.approx(math.cos(math.radians(12.0)))
