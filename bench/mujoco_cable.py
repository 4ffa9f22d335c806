"""A cable of MuJoCo in the channel of the plant beside the rod: forces within what their contacts differ, and the cost.

Both are straight, uniform and equally stiff, and a rigid gripper pushes them straight in between the same walls and lips.
MuJoCo's are capsules on hinges with springs and dampers, B / l and tau B / l. Its elasticity plug-in's cable bends in
space, and leaves the plane where the rod cannot; floor and lid would hold it, for contacts of their own. A hinge is also
the cheaper. What remains different: inertia, which MuJoCo cannot do without, and contacts, which have their impedance in
units of acceleration there and are springs against the rod. Recess, face, floor and lid are left out of both.
"""

import math
import time
from dataclasses import dataclass
from typing import Any

import numpy as np

from bench.figures import Figure, Target, compare, in_turns
from bench.rod_insertion import TRACE, Case, new_records, run_ticks
from sim_backends.plant.options import Array, Phantom
from sim_backends.plant.scala import LEFT_LIP, LEFT_RECESS, wall_at

PART = "mujoco"
ROUNDS = 5
SEGMENTS = 40
RADIUS_MM, BENDING_NMM2 = 0.3, 1.0
FRICTION = 0.2
DEPTH_MM, START_MM, SPEED_MM_PER_MS = 8.0, -1.0, 1e-3
SUBSTEPS = 10
"""Of MuJoCo in a millisecond: with 4, contacts bounce apart and what they bear is lost; 20 change a few percent."""
MASS_G = 0.01
"""Of a segment, ten times a real one's: less, and contacts are soft, whose stiffness goes with it; more, and it bounces."""
RELAXATION_MS = 20.0
WALL_MM, WALL_STEP_MM, WALL_LENGTH_MM = 0.4, 0.3, 12.0
TOUCHED_N = 0.01
FACTOR = Target(10.0, at_least=True)
"""By which the rod is cheaper."""


@dataclass(frozen=True)
class Scene:
    """The rod's records, and gripper poses (n, 3) one a millisecond."""

    rod: np.ndarray
    scala: np.ndarray
    pose: np.ndarray
    depth_mm: np.ndarray
    along: np.ndarray


def measure() -> list[Figure]:
    """Mean force after contact of both, and cost of a simulated millisecond in turns."""
    try:
        import mujoco
    except ImportError:
        return [Figure(PART, "cable", "us", None, note="skipped: no mujoco here, which the extra `bench` installs")]
    scene = make_scene()
    model = mujoco.MjModel.from_xml_string(cable_xml(scene))
    note = f"MuJoCo {mujoco.__version__}, {SUBSTEPS} steps a millisecond"
    theirs, ours = push_cable(mujoco, model, scene)[0], push_rod(scene)[0]
    touched = scene.depth_mm > scene.depth_mm[np.argmax(ours > TOUCHED_N)]
    mean = float(ours[touched].mean()), float(theirs[touched].mean())
    ripple = float(np.std(np.diff(ours[touched]))), float(np.std(np.diff(theirs[touched])))
    share = f"MuJoCo's is {mean[1] / mean[0]:.0%}; from {scene.depth_mm[touched][0]:.1f} mm on; {note}"
    figures = [
        Figure(PART, "mean force after contact", "N", *mean, "MuJoCo", note=share),
        Figure(PART, "force at the end", "N", float(ours[-200:].mean()), float(theirs[-200:].mean()), "MuJoCo"),
        Figure(PART, "change of the force in a ms, rms", "N", *ripple, "MuJoCo"),
    ]
    rod, cable = in_turns(ROUNDS, lambda: push_rod(scene)[1], lambda: push_cable(mujoco, model, scene)[1])
    factor = compare(PART, "cable over rod, a simulated ms", "us", cable, rod, reference_name="rod", target=FACTOR)
    return [*figures, factor]


def make_scene() -> Scene:
    """Straight into the scala along the axis of insertion."""
    array = Array(segments=SEGMENTS, axial_stiffness_n=500.0, grip_angle_rad=0.0)
    tissue = Phantom(
        wall_stiffness_n_per_mm2=10.0, friction=FRICTION, friction_static=FRICTION, floor_load_n_per_mm=0.0
    )
    rod, scala = new_records(Case(array=array, tissue=tissue))
    r, s = rod[0], scala[0]
    r["array_nmm2"], r["stylet_nmm2"], r["rest_per_mm"], r["radius_mm"] = BENDING_NMM2, 0.0, 0.0, RADIUS_MM
    r["array_yield_per_mm"] = 1e3
    s["post_mm"][LEFT_RECESS:] = 1e3
    depth = np.arange(START_MM, DEPTH_MM, SPEED_MM_PER_MS)
    along = s["axis"].copy()
    left = np.array([-along[1], along[0]])
    tip = s["entry_mm"] + RADIUS_MM * left + depth[:, None] * along  # the body's middle enters in the hole's
    bearing = np.full(len(depth), math.atan2(along[1], along[0]))
    return Scene(rod, scala, np.column_stack((tip - array.length_mm * along, bearing)), depth, along)


def push_rod(scene: Scene) -> tuple[np.ndarray, float]:
    """Forces against the motion (n,) [N], and cost [us] of a millisecond."""
    rod, trace = scene.rod.copy(), np.zeros(len(scene.pose), TRACE)
    start = time.perf_counter()
    done = run_ticks(rod, scene.scala, scene.pose, np.zeros(len(scene.pose)), 1e-3, trace)
    cost = (time.perf_counter() - start) / done * 1e6
    return -trace["wrench"][:, :2] @ scene.along, cost


def push_cable(mujoco: Any, model: Any, scene: Scene) -> tuple[np.ndarray, float]:
    """The same of MuJoCo."""
    data = mujoco.MjData(model)
    left = np.array([-scene.along[1], scene.along[0]])
    force = np.zeros(len(scene.pose))
    mujoco.mj_forward(model, data)
    start = time.perf_counter()
    for k, pose in enumerate(scene.pose):
        data.mocap_pos[0, :2] = pose[:2] - RADIUS_MM * left
        for _ in range(SUBSTEPS):
            mujoco.mj_step(model, data)
        force[k] = data.sensordata[0]
    return force, (time.perf_counter() - start) / len(force) * 1e6


def cable_xml(scene: Scene) -> str:
    """Units: mm, g, ms, and so N. The body at the gripper is moved by hand; boxes and posts are the channel."""
    s, pose = scene.scala[0], scene.pose[0]
    edge = float(scene.rod["edge_mm"][0])
    left = np.array([-scene.along[1], scene.along[0]])
    base = pose[:2] - RADIUS_MM * left
    return f"""
<mujoco>
  <compiler autolimits="true" angle="radian"/>
  <size memory="64M"/>
  <option timestep="{1.0 / SUBSTEPS}" gravity="0 0 0" integrator="implicitfast" cone="elliptic" impratio="10"/>
  <default>
    <geom friction="{FRICTION} 0 0" condim="3" solref="{2.0 / SUBSTEPS} 1" solimp="0.99 0.999 0.005"/>
    <joint type="hinge" axis="0 0 1" stiffness="{BENDING_NMM2 / edge}" damping="{RELAXATION_MS * BENDING_NMM2 / edge}"/>
    <default class="segment">
      <geom type="capsule" size="{RADIUS_MM}" mass="{MASS_G}" contype="2" conaffinity="1"/>
    </default>
  </default>
  <worldbody>
    {_channel(s)}
    <body name="gripper" mocap="true" pos="{base[0]} {base[1]} 0" euler="0 0 {pose[2]}">
      <site name="felt"/>
      {_segments(SEGMENTS - 1, 0.5 * edge, edge)}
    </body>
  </worldbody>
  <sensor><force site="felt"/></sensor>
</mujoco>"""


def _segments(count: int, at_mm: float, edge_mm: float) -> str:
    """Each hangs on the one before; the first joint is half a segment before the gripper, as the rod's."""
    if count == 0:
        return ""
    capsule = f'<geom class="segment" fromto="0 0 0 {edge_mm} 0 0"/>'
    return f'<body pos="{at_mm} 0 0"><joint/>{capsule}{_segments(count - 1, edge_mm, edge_mm)}</body>'


def _channel(s: np.void) -> str:
    """Both walls as boxes that touch the scala from outside, and the lips."""
    boxes = []
    for at in np.arange(0.0, WALL_LENGTH_MM, WALL_STEP_MM):
        x, y, tx, ty, _, width, _ = wall_at(s, float(s["entry_arc_mm"]) + at)
        for out in (-WALL_MM, width + WALL_MM):
            boxes.append(
                f'<geom type="box" pos="{x - out * ty} {y + out * tx} 0" euler="0 0 {math.atan2(ty, tx)}" '
                f'size="{0.6 * WALL_STEP_MM} {WALL_MM} 3" contype="1" conaffinity="2"/>'
            )
    for post in range(LEFT_LIP, LEFT_RECESS):
        (x, y), r = s["post_mm"][post], s["post_radius_mm"][post]
        boxes.append(f'<geom type="cylinder" pos="{x} {y} 0" size="{r} 3" contype="1" conaffinity="2"/>')
    return "\n    ".join(boxes)
