"""Parts of the bench without their faults, each by its own switch, so that a test can look at the others alone."""

from dataclasses import fields, replace

from rtctl.robots.planar_3rpr import Planar3rprOptions
from sim_backends.plant.options import Geometry, Motor, PlantOptions, Sensor, StyletDrive, Wire

RIGID_N = 1e9
"""Stiffness of a wire that does not stretch: below a nanometre at an insertion's forces, and above rounding errors."""
AT_ONCE_S = 0.0
UNLIMITED = 1e12
FINE_COUNTS = 2**40


def idealised(options: PlantOptions) -> PlantOptions:
    """The options with the parameters of every part that `options.ideal` names replaced by ideal ones.

    Some of them are beyond the bounds of their options, which are for machines that could be built.
    """
    ideal = options.ideal
    motor, rod, wire = options.motor, options.stylet, options.wire
    geometry, sensor = options.geometry, options.sensor
    if ideal.drive:
        motor, rod = _drive(motor), replace(rod, motor=_drive(rod.motor))
    if ideal.screw:
        motor, rod = replace(motor, screw_efficiency=1.0), _screw(rod)
    if ideal.encoder:
        motor = replace(motor, counts_per_turn=FINE_COUNTS)
        rod = replace(rod, motor=replace(rod.motor, counts_per_turn=FINE_COUNTS))
    if ideal.wire:
        wire = _wire(wire)
    if ideal.geometry:
        nominal = Planar3rprOptions()
        geometry = Geometry(**{f.name: getattr(nominal, f.name) for f in fields(nominal)})
        wire = replace(wire, home_error_mm=(0.0,) * 3)
    if ideal.sensor:
        sensor = _sensor(sensor)
    return replace(options, motor=motor, stylet=rod, wire=wire, geometry=geometry, sensor=sensor)


def _drive(motor: Motor) -> Motor:
    """A linear machine, J dw/dt + b w = K g u: no electrical pole, no limit of the current, no dry friction."""
    return replace(motor, amplifier="current", current_limit_a=UNLIMITED, coulomb_nmm=0.0)


def _screw(rod: StyletDrive) -> StyletDrive:
    return replace(rod, friction_n=0.0, motor=replace(rod.motor, screw_efficiency=1.0))


def _wire(wire: Wire) -> Wire:
    return replace(
        wire,
        stiffness_n=RIGID_N,
        settling_s=AT_ONCE_S,
        backlash_rad=(0.0,) * 3,
        misalignment_mm=(0.0,) * 3,
    )


def _sensor(sensor: Sensor) -> Sensor:
    return replace(
        sensor,
        bias=(0.0,) * 6,
        drift_per_min=(0.0,) * 6,
        force_noise_n=0.0,
        moment_noise_nmm=0.0,
        force_step_n=0.0,
        moment_step_nmm=0.0,
        cross_axis_error=0.0,
        cutoff_hz=UNLIMITED,
    )
