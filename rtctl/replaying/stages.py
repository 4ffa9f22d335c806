"""The output signals in the order in which a tick computes them: the first that differs is nearest to the cause."""

from collections.abc import Iterable

STAGES: dict[str, tuple[str, ...]] = {
    "pose": ("pose_measured", "joint_measured", "stylet_measured_mm", "kinematic_iterations"),
    "wrench": ("wrench_in_base", "force_axial_n", "force_lateral_n", "is_unbiased"),
    "guidance": (
        "detector_samples", "predicted_force_n", "fold_decision", "fold_bound", "buckling_integral", "buckling_bound",
        "detector_flags", "impedance_usable", "impedance_jacobian_norm", "impedance_step_mm", "impedance_offset_mm", "impedance_phase",
    ),
    "decision": (
        "command_verdict", "reason_value", "reason_bound", "parameter_set", "plan_number", "operating_state",
        "stop_cause", "is_homed", "array_loaded", "pose_entry",
    ),
    "motion": (
        "pose_goal", "depth_goal_mm", "motion", "task_state", "is_busy", "pose_desired", "depth_mm",
        "depth_rate_mm_per_s", "stylet_desired_mm",
    ),
    "admittance": ("admittance_offset_mm", "stylet_reference_mm"),
    "trajectory": ("pose_reference", "joint_reference"),
    "llc": ("axis_reference_rad", "command_desired_v", "command_applied_v"),
    "protection": (
        "condition_active", "condition_latched", "condition_reported", "condition_value", "condition_bound",
        "fault_cause", "power_request",
    ),
}  # fmt: skip
"""Stage -> its signals, both in the order of :func:`rtctl.tick.tick`."""

OTHER = "other"
"""Stage of signals that this table does not know: of another version."""

_PLACE = {name: i for i, name in enumerate(name for names in STAGES.values() for name in names)}


def along_the_tick(names: Iterable[str]) -> list[str]:
    """`names` in the order in which a tick computes them; unknown ones last."""
    return sorted(names, key=lambda name: _PLACE.get(name, len(_PLACE)))


def stage_of(name: str) -> str:
    """The stage that computes a signal."""
    return next((stage for stage, names in STAGES.items() if name in names), OTHER)
