"""What differs from one insertion to the next: specimen, ear, errors of registration, and the scatter of all that.

:func:`draw` turns options into those of one insertion. It does so in two steps, because the first one is what a table
of insertions tells: :func:`sample` puts numbers in place of the scatter, :func:`place` moves the cochlea by them.
"""

import math
from dataclasses import fields, replace
from statistics import NormalDist
from typing import Any

import numpy as np

from sim_backends.plant.options import Anatomy, Phantom, PlantOptions

SPAWN_KEY = 1
"""Keeps these draws apart from those of sensor noise and matrix error, which come from the same seed."""
TRUNCATION_SIGMA = 3.0
SCATTERED = ("lateral", "out_of_plane", "angle", "stylet", "curvature", "friction")
"""What is drawn, in this order; each has its own number, so that no standard deviation changes another's draw."""
RUBS = ("friction", "friction_static", "floor_load_n_per_mm")
"""What one lubricant, or the lack of it, scales together."""


def draw(options: PlantOptions, seed: int) -> PlantOptions:
    """The bench of one insertion: `trial` drawn from the seed and carried out.

    The result has a neutral `trial` and the drawn values in their places, so printing it is enough to run the very
    same insertion again. It does not depend on anything but the arguments.
    """
    return place(sample(options, seed))


def specimen(options: PlantOptions) -> Phantom:
    """The table of the specimen that is inserted into."""
    return options.bone if options.trial.specimen == "bone" else options.phantom


def sample(options: PlantOptions, seed: int) -> PlantOptions:
    """The same options with numbers in place of the scatter: identical if there is none.

    Draws are normal, cut off at three standard deviations, and clipped to the bounds of the option they go into.
    """
    if not options.trial.scatter:
        return options
    z, kind = _normals(seed), specimen(options)
    trial, array = options.trial, options.array
    late_mm = kind.stylet_late_mm + kind.stylet_sd_mm * z["stylet"]
    factor = max(1.0 + kind.friction_sd * z["friction"], 0.0)
    drawn = {
        "trial": bounded(
            trial,
            scatter=False,
            lateral_mm=trial.lateral_mm + kind.lateral_sd_mm * z["lateral"],
            out_of_plane_mm=trial.out_of_plane_mm + kind.out_of_plane_sd_mm * z["out_of_plane"],
            angle_rad=trial.angle_rad + kind.angle_sd_rad * z["angle"],
        ),
        "array": bounded(
            array,
            stylet_offset_mm=array.stylet_offset_mm - late_mm,
            curvature_error=array.curvature_error + kind.curvature_sd * z["curvature"],
        ),
        trial.specimen: bounded(kind, **{name: factor * getattr(kind, name) for name in RUBS}),
    }
    return replace(options, **drawn)


def place(options: PlantOptions) -> PlantOptions:
    """The same options with the errors and the ear of `trial` carried out, and none left in it.

    The entry moves to the left of the insertion axis and the cochlea turns about it. For a left ear, the mirror image
    of a right one, the robot is mounted turned over about x of {B}. In {B} the plane then looks the same; what comes
    from outside, gravity and an error across the plane, changes its sign along y and z; what turns with the robot, such
    as the centre of mass in {F}, does not.
    """
    trial, anatomy, gravity = options.trial, options.anatomy, options.sensor.gravity_direction_in_base
    axis = anatomy.insertion_angle_rad
    left = np.array((-math.sin(axis), math.cos(axis)))
    entry = np.array(anatomy.entry_in_base_mm) + trial.lateral_mm * left
    up_mm = trial.out_of_plane_mm
    if trial.side == "left":
        up_mm, gravity = -up_mm, (gravity[0], 0.0 - gravity[1], 0.0 - gravity[2])  # 0.0 - x prints no -0.0
    return replace(
        options,
        anatomy=bounded(
            _turned(anatomy, trial.angle_rad),
            entry_in_base_mm=tuple(entry.tolist()),
            out_of_plane_mm=anatomy.out_of_plane_mm + up_mm,
        ),
        sensor=replace(options.sensor, gravity_direction_in_base=gravity),
        trial=replace(trial, side="right", lateral_mm=0.0, out_of_plane_mm=0.0, angle_rad=0.0),
    )


def told(sampled: PlantOptions) -> dict[str, float]:
    """What a table of insertions says of one, by names with units; `sampled` comes from :func:`sample`."""
    trial, array = sampled.trial, sampled.array
    return {
        "lateral_mm": trial.lateral_mm,
        "out_of_plane_mm": trial.out_of_plane_mm,
        "angle_rad": trial.angle_rad,
        "stylet_offset_mm": array.stylet_offset_mm,
        "curvature_error": array.curvature_error,
        "friction": specimen(sampled).friction,
    }


def bounded(table: Any, **values: Any) -> Any:
    """The options `table` with new values, numbers among them clipped to the bounds declared for them."""
    declared = {f.name: f.metadata for f in fields(table)}
    return replace(table, **{name: _clip(declared[name], value) for name, value in values.items()})


def _clip(declared: Any, value: Any) -> Any:
    if isinstance(value, tuple):
        return tuple(_clip(declared, v) for v in value)
    low, high = declared["low"], declared["high"]
    return min(max(value, low), high) if isinstance(value, float) else value


def _normals(seed: int) -> dict[str, float]:
    """One truncated standard normal for everything in `SCATTERED`."""
    normal = NormalDist()
    rest = normal.cdf(-TRUNCATION_SIGMA)
    uniform = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(SPAWN_KEY,))).random(len(SCATTERED))
    return {name: normal.inv_cdf(rest + (1.0 - 2.0 * rest) * u) for name, u in zip(SCATTERED, uniform, strict=True)}


def _turned(anatomy: Anatomy, angle_rad: float) -> Anatomy:
    """The same anatomy turned about its entry; beyond the bounds of the bearing, the same direction within them."""
    bearing = anatomy.insertion_angle_rad + angle_rad
    turned = bounded(anatomy, insertion_angle_rad=bearing)
    if turned.insertion_angle_rad == bearing:
        return turned
    return bounded(anatomy, insertion_angle_rad=math.remainder(bearing, math.tau))
