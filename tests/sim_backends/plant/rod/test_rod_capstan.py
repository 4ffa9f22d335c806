"""Spec 08 section 5, item 3: axial force along a circular channel, T(theta) = (f R / mu) (e^(mu theta) - 1)."""

import math

import numpy as np
import pytest

from hal.kernel import kernel
from sim_backends.plant.options import Array, Phantom
from sim_backends.plant.rod.state import ROD, pack
from sim_backends.plant.rod.step import advance, lift, place
from sim_backends.plant.scala import SCALA, WALL_POINTS, put_tissue, put_walls

RADIUS_MM = 4.0
WIDTH_MM = 1.0
FRICTION = 0.3
FLOOR_N_PER_MM = 0.01
LENGTH_MM = 16.0
SEGMENTS = 80
SPEED_MM_PER_S, STEP_S = 2.0, 1e-3


@kernel
def _start(rod, pose):
    lift(rod[0])
    place(rod[0], pose, 0.0)


@kernel
def _run(rod, scala, poses, step_s):
    failed = 0
    for k in range(poses.shape[0]):
        failed += not advance(rod[0], scala[0], poses[k], 0.0, step_s)
    return failed


def channel(outer_mm):
    """A channel all round, its right wall a circle about the origin that begins at (R, 0)."""
    scala = np.zeros(1, SCALA)
    tissue = Phantom(
        wall_stiffness_n_per_mm2=50.0, friction=FRICTION, friction_static=FRICTION, floor_load_n_per_mm=FLOOR_N_PER_MM
    )
    put_tissue(scala[0], tissue)
    arc_step_mm = 0.085
    angle = arc_step_mm * np.arange(WALL_POINTS) / outer_mm
    put_walls(
        scala[0],
        outer_mm * np.stack((np.cos(angle), np.sin(angle)), axis=1),
        np.full(WALL_POINTS, WIDTH_MM),
        arc_step_mm,
    )
    scala[0]["entry_mm"], scala[0]["axis"] = (outer_mm, -1.0), (0.0, 1.0)  # behind the gripper: all nodes are inside
    scala[0]["post_mm"] = 1e3
    return scala


def pose_at(angle):
    return np.array([RADIUS_MM * math.cos(angle), RADIUS_MM * math.sin(angle), angle + math.pi / 2])


def slid(start_rad, travel_mm, outer_mm):
    """A thin rod of the channel's curvature, slid along it for `travel_mm`; the ROD record."""
    # the fluid's drag would come on top of what the floor does
    options = Array(
        length_mm=LENGTH_MM, segments=SEGMENTS, grip_angle_rad=0.0, axial_stiffness_n=500.0, drag_n_s_per_mm=1e-7
    )
    rod = np.zeros(1, ROD)
    r = rod[0]
    pack(options, r)
    r["stylet_nmm2"], r["array_nmm2"], r["radius_mm"] = 0.0, 0.02, 0.0  # hardly bent, and without stiffness to speak of
    r["rest_per_mm"] = 1.0 / RADIUS_MM
    _start(rod, pose_at(start_rad))
    scala = channel(outer_mm)
    r["inside_from"] = 2
    arc = (np.arange(SEGMENTS + 1) - 0.5) * r["edge_mm"]
    r["foot_mm"][: SEGMENTS + 1] = (start_rad + arc / RADIUS_MM) * outer_mm
    ticks = round(abs(travel_mm) / SPEED_MM_PER_S / STEP_S)
    angles = start_rad + np.linspace(0.0, travel_mm / RADIUS_MM, ticks + 1)[1:]
    assert _run(rod, scala, np.array([pose_at(angle) for angle in angles]), STEP_S) == 0
    return r


@pytest.mark.parametrize(("way", "outer_mm"), [(1, RADIUS_MM), (-1, RADIUS_MM + WIDTH_MM)], ids=["pushed", "pulled"])
def test_axial_force_grows_as_along_a_capstan(way, outer_mm):
    """Pushed it lies against the outer wall, pulled against the inner one; either way the drag grows the same."""
    rod = slid(0.1 if way > 0 else 0.9, way * 2.0, outer_mm)
    edges = np.diff(rod["node_mm"][: SEGMENTS + 1], axis=0)
    stretch_mm = np.hypot(*edges.T) - rod["edge_mm"]
    force_n = -way * rod["stretch_n_per_mm"] * stretch_mm[1:]
    from_tip_mm = (SEGMENTS - np.arange(1, SEGMENTS) - 0.5) * rod["edge_mm"]  # of the edges' middles
    theta = from_tip_mm / RADIUS_MM
    drag_n_per_mm = FRICTION * FLOOR_N_PER_MM
    capstan_n = drag_n_per_mm * RADIUS_MM / FRICTION * np.expm1(FRICTION * theta)
    assert capstan_n[0] > 2.0 * drag_n_per_mm * LENGTH_MM * 0.9  # the channel doubles what the floor alone would do
    assert force_n == pytest.approx(capstan_n, abs=0.03 * capstan_n[0])
    inner = theta > 0.4 * theta[0]  # nearer to the tip it counts that the tip node stands for a whole segment
    assert force_n[inner] == pytest.approx(capstan_n[inner], rel=0.03)
    along = np.array([math.cos(rod["pose"][2]), math.sin(rod["pose"][2])])
    assert -way * float(rod["wrench"][:2] @ along) == pytest.approx(capstan_n[0], rel=0.03)
