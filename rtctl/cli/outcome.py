"""What a finished insertion comes to: the figures worth a line, and the exit code."""

from collections.abc import Mapping
from typing import Any

from hal.errors import RtctlError
from rtctl.cli.exit_codes import Exit

SHOWN = (
    ("outcome", "outcome", 1.0, "", ""),
    ("depth", "depth_mm", 1.0, ".1f", "mm"),
    ("insertion force, mean", "insertion_force_mean_n", 1e3, ".1f", "mN"),
    ("insertion force, peak", "insertion_force_peak_n", 1e3, ".1f", "mN"),
    ("after the stylet starts", "post_aos_force_mean_n", 1e3, ".1f", "mN"),
    ("lateral force, mean", "lateral_force_mean_n", 1e3, ".1f", "mN"),
    ("stylet", "stylet_mm", 1.0, ".1f", "mm"),
    ("tip off its reference, rms", "tip_path_error_rms_mm", 1e3, ".0f", "µm"),
    ("ticks", "ticks", 1.0, "d", ""),
    ("overruns", "overruns", 1.0, "d", ""),
    ("records lost", "lost_records", 1.0, "d", ""),
    ("tick, median", "tick_us_p50", 1.0, ".1f", "µs"),
    ("lateness, 99 %", "lateness_us_p99", 1.0, ".0f", "µs"),
    ("real-time factor", "real_time_factor", 1.0, ".3g", ""),
    ("grade", "grade", 1.0, "", ""),
)
"""Words, name in the summary, factor to the unit shown, format, unit."""


def key_figures(summary: Mapping[str, Any]) -> dict[str, str]:
    """The figures of a summary that are known, in words."""
    shown = {}
    for words, name, factor, form, unit in SHOWN:
        value = summary[name]
        if value is not None:
            number = value if not form or form == "d" else value * factor
            shown[words] = f"{number:{form}} {unit}".rstrip()
    return shown


def exit_code(summary: Mapping[str, Any], failure: RtctlError | None = None) -> Exit:
    """OK only if the insertion reached its depth with no fault and nothing was lost."""
    if summary["outcome"] == "fault":
        return Exit.FAULT
    if failure is not None:
        return Exit(failure.exit_code)
    if summary["outcome"] != "completed":
        return Exit.FAILED
    return Exit.OK if summary["lost_records"] == 0 and summary["log_complete"] else Exit.DATA
