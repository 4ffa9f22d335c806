"""The array on its anatomy: signs, sizes, invariances, and walls that are those of the template."""

import math

import numpy as np
import pytest

from hal.kernel import kernel
from rtctl.electrode import cochlea
from rtctl.electrode.array_shape import LENGTH_MM
from sim_backends.plant.anatomy import ARC_STEP_MM, WALL_POINTS, wall_at
from sim_backends.plant.backend import PlantBackend
from sim_backends.plant.contact import NODES, array_wrench, lift

ENTRY, ANGLE = np.array([172.6, 4.7]), 0.224
STRAIGHT = {"curvature_error": 0.0, "grip_angle_rad": 0.0}


@kernel
def _wrench(device, pose, stylet_mm, wrench):
    array_wrench(device[0].array, device[0].anatomy, pose, stylet_mm, wrench)


@kernel
def _lift(device):
    lift(device[0].array)


class Scene:
    """An array that is moved by hand."""

    def __init__(self, anatomy=None, array=None):
        table = {"array": STRAIGHT | (array or {}), "anatomy": anatomy or {}}
        self.backend = PlantBackend(table, period_s=0.001, seed=1)
        self.device = self.backend.compiled().device
        self.array, self.anatomy = self.device[0]["array"], self.device[0]["anatomy"]
        self.entry, self.axis = self.anatomy["entry_mm"], self.anatomy["axis"]
        tip = self.array["free_shape_mm"][0, -1] - self.array["free_shape_mm"][0, -7]  # chord of the last 3 mm
        self.angle = math.atan2(self.axis[1], self.axis[0]) - math.atan2(tip[1], tip[0])

    def pose(self, depth_mm, aside_mm=0.0):
        """Gripper pose that brings the tip of the straight array to `depth_mm` behind the entry, along its axis."""
        c, s = math.cos(self.angle), math.sin(self.angle)
        tip = self.array["free_shape_mm"][0, -1]
        across = np.array([-self.axis[1], self.axis[0]])
        place = self.entry + depth_mm * self.axis + aside_mm * across - np.array([[c, -s], [s, c]]) @ tip
        return np.array([*place, self.angle])

    def touch(self, pose, stylet_mm=0.0):
        wrench = np.empty(3)
        _wrench(self.device, np.asarray(pose, dtype=float), stylet_mm, wrench)
        return wrench

    def insert(self, depth_mm, aside_mm=0.0, stylet=lambda _: 0.0):
        """Advance from outside in small steps; the wrenches (n, 3) on the way."""
        depths = np.arange(-1.003, depth_mm + 1e-9, 0.01)  # no node stops right in the plane of the entry
        return np.array([self.touch(self.pose(d, aside_mm), stylet(d)) for d in depths])

    def along_and_aside(self, wrench):
        return wrench[0] * self.axis[0] + wrench[1] * self.axis[1], wrench[1] * self.axis[0] - wrench[0] * self.axis[1]


def test_the_walls_are_those_of_the_template():
    anatomy = Scene({"entry_in_base_mm": [0.0, 0.0], "insertion_angle_rad": 0.0}).anatomy
    turn = -cochlea.insertion_path().direction_rad
    rotation = np.array([[math.cos(turn), -math.sin(turn)], [math.sin(turn), math.cos(turn)]])
    angles = np.arange(10.3, 700.0, 0.05)
    lateral = (cochlea.lateral_wall(angles) - cochlea.insertion_point()) @ rotation.T
    modiolar = (cochlea.modiolar_wall(angles) - cochlea.insertion_point()) @ rotation.T
    kink = np.linalg.norm(lateral - lateral[np.argmin(abs(angles - 100.0))], axis=1)
    for arc in np.arange(0.5, 28.0, 0.37):
        x, y, tx, ty, _, width = wall_at(anatomy, arc)
        assert math.hypot(tx, ty) == pytest.approx(1.0, abs=1e-3)
        near = np.linalg.norm(lateral - (x, y), axis=1)
        assert near.min() < 0.01
        if kink[near.argmin()] > 0.5:
            assert np.linalg.norm(modiolar - (x - width * ty, y + width * tx), axis=1).min() < 0.02
    assert ARC_STEP_MM * (WALL_POINTS - 1) > 20.8924 + 5  # beyond the first turn (02 section 1) by a second half


def test_nothing_happens_before_the_entry():
    scene = Scene()
    assert scene.touch(scene.pose(-0.5)) == pytest.approx([0.0, 0.0, 0.0], abs=0)
    assert scene.array["contacts"] == 0
    assert scene.array["depth_mm"] == 0.0


def test_the_depth_is_the_length_behind_the_entry():
    scene = Scene()
    scene.insert(4.0)
    assert scene.array["depth_mm"] == pytest.approx(4.0, abs=0.05)
    assert scene.array["in_hole"]


@pytest.mark.parametrize("depth_mm", [4.0, 6.0])
def test_a_sideways_error_is_pushed_back_with_tens_of_millinewtons(depth_mm):
    forces = {}
    for aside in (-0.5, 0.0, 0.5):
        scene = Scene()
        _, forces[aside] = scene.along_and_aside(scene.insert(depth_mm, aside)[-1])
    assert forces[0.5] < forces[0.0] - 0.01
    assert forces[-0.5] > forces[0.0]
    assert 0.02 < abs(forces[0.5]) < 0.4


def test_the_push_grows_with_the_error_and_with_depth():
    scene = {a: Scene() for a in (0.2, 0.4, 0.6)}
    run = {a: np.array([s.along_and_aside(w)[1] for w in s.insert(6.0, a)]) for a, s in scene.items()}
    at = {depth: round((depth + 1.0) / 0.01) for depth in (2.0, 4.0, 6.0)}
    assert 0 > run[0.2][at[6.0]] > run[0.4][at[6.0]] > run[0.6][at[6.0]]
    assert 0 > run[0.4][at[2.0]] > run[0.4][at[4.0]] > run[0.4][at[6.0]]


def test_friction_resists_the_way_in_and_the_way_out():
    scene = Scene()
    pushed, _ = scene.along_and_aside(scene.insert(5.0)[-1])
    for depth in np.arange(5.0, 4.6, -0.01):
        pulled, _ = scene.along_and_aside(scene.touch(scene.pose(depth)))
    assert pushed < -0.02
    assert pulled > pushed + 0.04
    held = scene.touch(scene.pose(depth))
    assert np.array_equal(scene.touch(scene.pose(depth)), held)  # at rest it neither creeps nor fades


def test_without_friction_the_wrench_is_a_function_of_the_pose():
    smooth = {"friction": 0.0, "floor_drag_n_per_mm": 0.0}
    straight, detour = Scene(smooth), Scene(smooth)
    straight.insert(6.0, 0.3)
    detour.insert(6.0, 0.3)
    for aside in (0.35, 0.2, 0.3):
        there = detour.touch(detour.pose(6.0, aside))
    assert there == pytest.approx(straight.touch(straight.pose(6.0, 0.3)), abs=1e-4)


def test_the_reported_stiffness_bounds_the_true_one():
    scene = Scene({"friction": 0.0, "floor_drag_n_per_mm": 0.0})
    scene.insert(6.0, 0.4)
    pose, step = scene.pose(6.0, 0.4), 1e-4
    scene.touch(pose)
    xx, xy, _, yy, _, _ = scene.array["stiffness"].copy()
    reported = np.array([[xx, xy], [xy, yy]])
    for direction in ((0.0, 1.0), (0.6, 0.8)):
        n = np.array(direction)
        change = scene.touch(pose + step * np.array([*n, 0.0])) - scene.touch(pose - step * np.array([*n, 0.0]))
        true = -(change[:2] @ n) / (2 * step)
        assert 0.2 * true < true <= 1.1 * (n @ reported @ n)
        assert true > 0.02


def test_the_wrench_turns_with_the_whole_scene():
    """Entry, array and gripper moved together: the same force, turned; the same moment."""
    turn, shift = 0.7, np.array([-30.0, 12.0])
    rotation = np.array([[math.cos(turn), -math.sin(turn)], [math.sin(turn), math.cos(turn)]])
    here = Scene()
    there = Scene({"entry_in_base_mm": list(rotation @ ENTRY + shift), "insertion_angle_rad": ANGLE + turn})
    stylet = lambda depth: max(0.0, 1.2 * depth)  # noqa: E731
    a, b = here.insert(8.0, 0.2, stylet), there.insert(8.0, 0.2, stylet)
    assert np.abs(a[:, :2]).max() > 0.02
    assert b[:, :2] == pytest.approx(a[:, :2] @ rotation.T, abs=1e-7)
    assert b[:, 2] == pytest.approx(a[:, 2], abs=1e-6)


def test_an_array_that_misses_the_hole_presses_on_the_bone_and_never_gets_in():
    scene = Scene()
    run = np.array([scene.along_and_aside(w)[0] for w in scene.insert(5.0, 1.2)])
    assert scene.array["face_contact"]
    assert not scene.array["in_hole"]
    assert run[-1] < -0.03
    assert run[-1] < run[300] < 0
    scene.touch(scene.pose(5.0, 0.0))  # sliding sideways below the surface is no way in
    assert not scene.array["in_hole"]
    scene.touch(scene.pose(-0.1, 0.0))
    scene.insert(1.0)
    assert scene.array["in_hole"]


def test_nodes_never_jump_to_the_next_turn():
    scene, last = Scene(), None
    for depth in np.arange(-0.5, 14.0, 0.02):
        scene.touch(scene.pose(depth), min(15.0, max(0.0, 1.15 * depth)))
        feet = scene.array["foot_mm"].copy()
        behind = int(scene.array["depth_mm"] / 0.5)
        assert (np.diff(feet[NODES - behind :]) >= 0).all()
        inside = scene.array["depth_mm"] > 1.0
        if last is not None and inside:
            assert np.abs(feet - last).max() < 0.3  # the next turn is 7 mm or more away
        last = feet if inside else None
    assert 8.0 < feet[-1] < 28.0


def test_the_free_shape_is_the_synthetic_array():
    """Points of array 1 by an independent quadrature of its bending angle."""
    from rtctl.electrode.synthetic_arrays import SYNTHETIC_ARRAYS

    shapes = Scene().array["free_shape_mm"]
    s = np.linspace(0, LENGTH_MM, 7201)
    for row, stylet in ((0, 0.0), (24, 6.0), (60, 15.0)):
        angle = SYNTHETIC_ARRAYS[0].angle_rad(s, np.array([stylet]))[:, 0]
        x = np.trapezoid(np.cos(angle), s)
        y = np.trapezoid(np.sin(angle), s)
        assert shapes[row, -1] == pytest.approx([x, y], abs=1e-4)
    assert shapes.shape == (61, NODES, 2)


def test_a_lifted_array_has_forgotten_everything():
    scene = Scene()
    first = scene.insert(6.0, 0.3)
    _lift(scene.device)
    assert np.array_equal(scene.insert(6.0, 0.3), first)
