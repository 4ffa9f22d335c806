"""From settings to the tick's parameter set: units per tick, one value a channel, nothing forgotten."""

import dataclasses
import math

import numpy as np
import pytest

from hal.options import describe, read
from rtctl import robots
from rtctl.memory import memory_dtype, parameters_dtype, profile_dtype, state_dtype
from rtctl.parameters import pack
from rtctl.settings import Settings, load, table_of

SETTINGS = load("planar-sim", [f"impedance.bias_ohm={[0.0] * 21}"])  # or guidance could not be switched on
ROBOT = robots.load(SETTINGS.robot.kind, SETTINGS.robot.geometry)


def packed(**changes):
    """Parameters with single options changed, named section__option; whether they go together is not looked at."""
    table = table_of(SETTINGS)
    for name, value in changes.items():
        section, _, option = name.partition("__")
        table[section][option] = value
    return pack(read(Settings, table), ROBOT, 7)[0]


def test_every_field_is_a_finite_number_and_the_set_carries_its_number():
    p = packed()
    for part in (p, p["impedance_law"]):
        for name in part.dtype.names:
            assert part.dtype[name].names or np.isfinite(part[name]).all(), name
    assert p["number"] == 7


def test_rates_become_steps_of_one_tick():
    fast, slow = packed(), packed(loop__period_s=0.002)
    for name in ("command_slew_v", "backlash_step_rad", "stylet_step_mm", "homing_step_rad"):
        assert slow[name] == pytest.approx(2 * fast[name]), name
    for name in ("unbias_ticks", "stream_ticks", "homing_stall_ticks", "homing_timeout_ticks"):
        assert slow[name] == fast[name] // 2, name
    assert fast["stylet_step_mm"] == pytest.approx(SETTINGS.stylet.speed_mm_per_s * 0.001)
    assert fast["stream_ticks"] == 50


def test_channels_are_lengths_then_angles_then_the_depth():
    t = SETTINGS.trajectory
    p = packed()
    assert p["speed"].tolist() == [t.speed_mm_per_s] * 2 + [t.speed_rad_per_s, t.depth_speed_mm_per_s]
    assert p["jerk"].tolist() == [t.jerk_mm_per_s3] * 2 + [t.jerk_rad_per_s3, t.depth_jerk_mm_per_s3]
    assert p["lateral_mask"].tolist() == [1.0, 1.0, 0.0]
    assert p["length_dofs"] == 2


def test_the_derivative_filter_has_its_cutoff():
    blend = float(packed(control__derivative_cutoff_hz=40.0)["derivative_blend"])
    ticks_to_63_percent = math.log(1 - 0.6321205588) / math.log(1 - blend)
    assert ticks_to_63_percent * 0.001 == pytest.approx(1 / (2 * math.pi * 40.0), rel=1e-6)


OF_A_DETECTOR = ("guidance.tip_fold", "guidance.buckling")
"""They need one, which guidance/test_watch.py has."""
LIVE = [(name, field) for name, _, field in describe(Settings) if field.metadata["live"] and name not in OF_A_DETECTOR]


@pytest.mark.parametrize(("name", "field"), LIVE, ids=[name for name, _ in LIVE])
def test_every_live_option_changes_the_set(name, field):
    section, option = name.split(".")
    value = getattr(getattr(SETTINGS, section), option)
    low, high = field.metadata["low"], field.metadata["high"]
    if isinstance(value, bool):
        other = not value
    elif isinstance(value, tuple):
        other = [v + 0.25 for v in value]
    elif isinstance(value, str):
        other = next(word for word in field.metadata["choices"] if word != value)
    else:
        other = value * 1.1 if value and value * 1.1 <= high and value * 1.1 >= low else (value + (low or 0)) / 2
    assert packed(**{f"{section}__{option}": other}).tobytes() != packed().tobytes()


def test_what_the_tick_needs_to_know_of_the_period_is_in_the_set():
    assert packed(loop__period_s=0.002)["period_s"] == 0.002


@pytest.mark.parametrize("dof", [3, 5, 6])
def test_memory_has_room_for_robots_of_every_size(dof):
    for dtype in (parameters_dtype(dof), state_dtype(dof), profile_dtype(dof), memory_dtype(ROBOT.record.dtype, dof)):
        assert dtype.isalignedstruct
        assert dtype.itemsize % 8 == 0
    assert profile_dtype(dof)["position"].shape[0] == dof + 1
    assert state_dtype(dof)["scratch"].shape[1] >= dof + 2


def test_settings_are_frozen():
    with pytest.raises(dataclasses.FrozenInstanceError):
        SETTINGS.loop.period_s = 1.0  # type: ignore[misc]
