"""From settings to the record the tick reads: units per tick, filter coefficients, one value a channel."""

import copy
import math
from typing import Any

import numpy as np

from rtctl.guidance.impedance import layout
from rtctl.guidance.layout import REACTIONS
from rtctl.memory import parameters_dtype
from rtctl.robots import Robot
from rtctl.settings import Settings


def pack(settings: Settings, robot: Robot, number: int) -> np.ndarray:
    """Parameter set `number`, shape (1,)."""
    s = settings
    parameters = np.zeros(1, parameters_dtype(robot.dof))
    p = parameters[0]
    period = s.loop.period_s
    p["number"], p["period_s"] = number, period
    p["length_dofs"] = robot.length_dofs

    p["moving_average"] = s.wrench.filter == "moving_average"
    p["window_ticks"] = max(round(s.wrench.window_s / period), 1)
    p["filter_b"], p["filter_a"] = butterworth_low_pass(s.wrench.cutoff_hz, period)
    p["gravity_force_in_base_n"] = s.wrench.gravity_force_in_base_n
    p["centre_of_mass_in_sensor_mm"] = s.wrench.centre_of_mass_in_sensor_mm
    p["unbias_ticks"] = round(s.wrench.unbias_s / period)

    a = s.admittance
    p["lateral_on"], p["project_first"], p["stylet_on"] = a.lateral, a.project_first, a.stylet
    for name in ("deadband_n", "lateral_gain_mm_per_n_s", "lateral_limit_mm", "stylet_gain_mm_per_n_s",
                 "regulated_force_n", "blend_start_mm", "blend_end_mm"):  # fmt: skip
        p[name] = getattr(a, name)
    p["lateral_mask"] = robot.translation_mask

    t = s.trajectory
    turns = robot.dof - robot.length_dofs
    for name, length, angle, depth in (
        ("speed", t.speed_mm_per_s, t.speed_rad_per_s, t.depth_speed_mm_per_s),
        ("acceleration", t.acceleration_mm_per_s2, t.acceleration_rad_per_s2, t.depth_acceleration_mm_per_s2),
        ("jerk", t.jerk_mm_per_s3, t.jerk_rad_per_s3, t.depth_jerk_mm_per_s3),
    ):
        p[name] = [length] * robot.length_dofs + [angle] * turns + [depth]
    p["stream_ticks"] = round(t.stream_limit_s / period)
    p["entry_tolerance_mm"] = t.entry_tolerance_mm

    c = s.control
    p["proportional"], p["integral"] = c.proportional_v_per_rad, c.integral_v_per_rad_s
    p["derivative"], p["feedforward"] = c.derivative_v_s_per_rad, c.feedforward_v_s_per_rad
    p["backlash_rad"] = c.backlash_rad
    p["derivative_blend"] = 1.0 - math.exp(-2.0 * math.pi * c.derivative_cutoff_hz * period)
    p["integral_limit_v"], p["command_limit_v"] = c.integral_limit_v, c.command_limit_v
    p["command_slew_v"] = c.command_slew_v_per_s * period
    p["backlash_step_rad"] = c.backlash_rate_rad_per_s * period

    p["stylet_lead_mm_per_rad"], p["stylet_stroke_mm"] = s.stylet.lead_mm_per_rad, s.stylet.stroke_mm
    p["stylet_step_mm"] = s.stylet.speed_mm_per_s * period

    h = s.homing
    p["homing_step_rad"], p["homing_limit_v"] = h.speed_rad_per_s * period, h.command_limit_v
    p["homing_stall_ticks"] = round(h.stall_s / period)
    p["homing_timeout_ticks"] = round(h.timeout_s / period)

    f = s.safety
    for name in ("following_error_rad", "force_limit_n", "drift_limit_n", "axes_age_ticks", "wrench_age_ticks", "power_on_ticks",
                 "overrun_ticks"):  # fmt: skip
        p[name] = getattr(f, name)
    p["overrun_window_ticks"] = round(f.overrun_window_s / period)
    p["overrun_window_limit"] = round(f.overrun_share * f.overrun_window_s / period)
    p["overrun_windows"] = f.overrun_windows
    p["drift_ticks"] = round(f.drift_s / period)

    g = s.guidance
    p["fold_margin"], p["buckling_two_sided"] = g.margin, g.two_sided
    p["fold_reaction"], p["buckling_reaction"] = REACTIONS[g.tip_fold], REACTIONS[g.buckling]
    _pack_impedance(s, p["impedance_law"])
    return parameters


def _pack_impedance(settings: Settings, law: np.void) -> None:
    """Fill a LAW record."""
    z, array, period = settings.impedance, settings.electrode, settings.loop.period_s
    law["on"], law["mode"] = z.guidance, layout.MODES[z.mode]
    law["pause_when_blind"] = z.when_blind == "pause"
    for name in ("pair_step", "pitch_mm", "interval_mm", "step_limit_mm", "factor_ohm", "exponent", "far_field_ohm",
                 "area_max_mm2", "open_ohm", "short_ohm", "noise_limit_ohm", "least_pairs"):  # fmt: skip
        law[name] = getattr(z, name)
    law["pairs"] = layout.CONTACTS - z.pair_step
    law["pair_age_ticks"], law["link_age_ticks"] = round(z.pair_age_s / period), round(z.link_age_s / period)
    law["length_mm"], law["modal_matrix"] = array.length_mm, array.modal_matrix
    law["place_mm"] = array.length_mm - z.first_contact_mm - z.pitch_mm * np.arange(layout.CONTACTS)
    law["bias_ohm"][: len(z.bias_ohm)] = z.bias_ohm
    law["left_out"][np.array(z.left_out, dtype=int)] = 1


def with_values(table: dict[str, Any], values: dict[str, Any]) -> dict[str, Any]:
    """A settings table with the values of a parameter set: sections, or options by their dotted names."""
    changed = copy.deepcopy(table)
    for name, value in values.items():
        *sections, last = name.split(".")
        place = changed
        for section in sections:
            place = place.setdefault(section, {})
        place[last] = value
    return changed


def butterworth_low_pass(cutoff_hz: float, period_s: float) -> tuple[list[float], list[float]]:
    """Coefficients (b, a) of the second-order Butterworth low-pass by the bilinear transform with pre-warping."""
    k = math.tan(math.pi * cutoff_hz * period_s)
    scale = 1.0 / (1.0 + math.sqrt(2.0) * k + k * k)
    b = k * k * scale
    return [b, 2.0 * b, b], [1.0, 2.0 * (k * k - 1.0) * scale, (1.0 - math.sqrt(2.0) * k + k * k) * scale]
