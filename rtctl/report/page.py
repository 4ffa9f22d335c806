"""The report as one HTML page that needs nothing else: figures first, then pictures, events, definitions, settings."""

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from html import escape
from importlib.resources import files
from string import Template
from typing import Any

from hal.options import describe
from rtctl.recording import Recording
from rtctl.report.style import GREEN, ORANGE, RED
from rtctl.settings import Settings, public_table
from rtctl.summary import FIGURES

COLOURS = {"completed": GREEN, "fault": RED, "paused": ORANGE}
TITLES = {
    "completed": "Insertion completed",
    "fault": "Insertion ended in a fault",
    "paused": "Insertion paused",
    "incomplete": "Insertion incomplete",
    "not inserted": "No insertion",
}

TILES = (
    ("depth_mm", "depth reached", 1.0, 1, "mm"),
    ("insertion_force_mean_n", "mean insertion force", 1e3, 0, "mN"),
    ("insertion_force_peak_n", "peak insertion force", 1e3, 0, "mN"),
    ("lateral_force_mean_n", "mean lateral force", 1e3, 0, "mN"),
    ("lateral_correction_mm", "largest path correction", 1.0, 2, "mm"),
    ("stylet_mm", "stylet withdrawn", 1.0, 1, "mm"),
    ("tip_path_error_rms_mm", "tip off its reference, rms", 1e3, 0, "µm"),
    ("lost_records", "records lost", 1.0, 0, ""),
)
"""Key figures on top: name, words, factor to the unit shown, decimals, unit."""

CAPTION_IN = 1.2
"""Height that title and caption of a picture take, about."""

LONGEST_VALUE = 400
"""Of a setting on the page [letters]."""

EPOCH_NS = 10**18
"""Time stamps above it are of the day; below it they count from the start of a lockstep run."""


@dataclass(frozen=True)
class Picture:
    """A picture as the page shows it; `svg` is an <svg> element, `height_in` its height at the common width."""

    title: str
    svg: str
    caption: str
    height_in: float


def page(recording: Recording, summary: Mapping[str, Any], pictures: Iterable[Picture]) -> str:
    """The page, an HTML text."""
    outcome = str(summary["outcome"])
    robot = recording.settings.robot
    return fill(
        "page.html",
        COLOURS.get(outcome, ORANGE),
        title=escape(f"{TITLES[outcome]}: {_depth(summary)} with robot {robot.name}"),
        outcome=escape(outcome),
        subtitle=_subtitle(recording, summary),
        causes=_causes(summary),
        tiles="".join(_tile(summary, *tile) for tile in TILES),
        pictures=columns(pictures),
        notes=_notes(summary),
        events=_events(recording),
        figures=_figures(summary),
        settings=_settings(recording.settings),
    )


def fill(template: str, accent: str, **content: str) -> str:
    """A template beside this file, filled with HTML; `accent` is the colour of the outcome."""
    folder = files("rtctl.report")
    style = Template((folder / "page.css").read_text()).substitute(accent=accent)
    return Template((folder / template).read_text()).substitute(style=style.rstrip(), **content)


def _depth(summary: Mapping[str, Any]) -> str:
    depth, goal = summary["depth_mm"], summary["depth_goal_mm"]
    if goal is None or summary["outcome"] == "completed":
        return f"{depth:.1f} mm"
    return f"{depth:.1f} of {goal:.1f} mm"


def _subtitle(recording: Recording, summary: Mapping[str, Any]) -> str:
    start_ns = int(recording.records["time_ns"][0])
    when = "simulated time"
    if start_ns > EPOCH_NS:
        when = datetime.fromtimestamp(start_ns * 1e-9, UTC).strftime("%Y-%m-%d %H:%M:%S UTC")
    parts = (
        when,
        f"{recording.settings.robot.kind.replace('_', ' ')} on backend {recording.settings.backend.name}",
        f"grade {summary['grade']}",
        f"{summary['duration_s']:.1f} s, {summary['ticks']} ticks",
        f"settings {summary['config_hash']}, seed {summary['seed']}",
    )
    return " · ".join(escape(part) for part in parts)


def _causes(summary: Mapping[str, Any]) -> str:
    causes = [c for c in (summary["fault_cause"], summary["stop_cause"]) if c]
    unique = {c["name"]: c for c in causes}.values()
    rows = [f"<p><b>{escape(c['text'])}.</b> {escape(c['remedy'])}.</p>" for c in unique]
    return f'<div class="causes">{"".join(rows)}</div>' if rows else ""


def _tile(summary: Mapping[str, Any], name: str, words: str, factor: float, decimals: int, unit: str) -> str:
    value = summary[name]
    text = "–" if value is None else f"{value * factor:.{decimals}f} <small>{unit}</small>"
    return f'<div class="tile"><b>{text}</b><span>{escape(words)}</span></div>'


def columns(pictures: Iterable[Picture]) -> str:
    """Two columns, each picture into the shorter one."""
    columns, heights = ["", ""], [0.0, 0.0]
    for picture in pictures:
        shorter = heights.index(min(heights))
        heights[shorter] += picture.height_in + CAPTION_IN
        columns[shorter] += (
            f"<figure><h3>{escape(picture.title)}</h3>{picture.svg}"
            f"<figcaption>{escape(picture.caption)}</figcaption></figure>"
        )
    return "".join(f"<div>{column}</div>" for column in columns if column)


def _notes(summary: Mapping[str, Any]) -> str:
    if summary["tick_us_p50"] is not None:
        return ""
    return (
        '<p class="soft">There are no timing histograms: a lockstep run has a virtual clock and measures no time.</p>'
    )


def _events(recording: Recording) -> str:
    start_ns = int(recording.records["time_ns"][0])
    rows = []
    for event in recording.events:
        remedy = f"; {event['remedy']}" if event.get("remedy") else ""
        rows.append(
            f'<tr class="{escape(event.get("severity", "info"))}">'
            f'<td class="number">{(event["time_ns"] - start_ns) * 1e-9:.3f} s</td>'
            f'<td class="wide">{escape(event["kind"])}</td><td>{escape(event["text"] + remedy)}</td></tr>'
        )
    return (
        f'<table><tr><th></th><th class="wide"></th><th></th></tr>{"".join(rows)}</table>'
        if rows
        else "<p>Nothing.</p>"
    )


def _figures(summary: Mapping[str, Any]) -> str:
    rows = []
    for figure in FIGURES:
        rows.append(
            f"<tr><td><code>{escape(figure.name)}</code></td>"
            f'<td class="value">{escape(_shown(summary[figure.name]))} {escape(figure.unit)}</td>'
            f"<td>{escape(figure.meaning)}</td></tr>"
        )
    return f'<table class="figures">{"".join(rows)}</table>'


def _shown(value: Any) -> str:
    if value is None:
        return "–"
    if isinstance(value, dict):
        return str(value["name"])
    if isinstance(value, float) and math.isfinite(value):
        return f"{value:.6g}"
    return str(value)


def _settings(settings: Settings) -> str:
    """Options that differ from their defaults in the open, all of them on demand."""
    table = public_table(settings)
    changed, every = [], []
    for name, _, field in describe(Settings):
        section, option = name.split(".")
        value = table[section][option]
        row = (
            f"<tr><td><code>{escape(name)}</code></td><td><code>{escape(_cut(_short(value)))}</code></td>"
            f'<td class="wide">{escape(str(field.metadata.get("doc", "")))}</td></tr>'
        )
        every.append(row)
        if value != _plain_default(field):
            changed.append(row)
    return (
        f"<p class='soft'>Different from the defaults:</p><table>{''.join(changed)}</table>"
        f"<details><summary>All {len(every)} settings</summary><table>{''.join(every)}</table></details>"
    )


def _plain_default(field: Any) -> Any:
    default = field.default_factory() if callable(field.default_factory) else field.default
    return _listed(default)


def _listed(value: Any) -> Any:
    return [_listed(v) for v in value] if isinstance(value, tuple) else value


def _cut(text: str) -> str:
    """A trained detector has a thousand numbers, and the log has them all."""
    return text if len(text) <= LONGEST_VALUE else f"{text[:LONGEST_VALUE]} …"


def _short(value: Any) -> str:
    if isinstance(value, float):
        return f"{value:g}"
    if isinstance(value, list):
        return f"[{', '.join(_short(v) for v in value)}]"
    if isinstance(value, dict):
        return ", ".join(f"{k} = {_short(v)}" for k, v in value.items())
    return str(value)
