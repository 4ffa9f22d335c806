"""The report of a run: one page with pictures, and the pictures as files.

report.write(directory)             the logs of a run's folder -> report.html, summary.json, figures/*.png
report.render(recording, directory) the same from a recording in memory
"""

from pathlib import Path
from typing import Any

from rtctl import summary as summaries
from rtctl.log.format import LogError
from rtctl.recording import Recording, logs_in, open_recording
from rtctl.report import cochlea_view, detection, force, motion, page, path, style, timing


def write(run_directory: str | Path, *, figures: bool = True) -> dict[str, Any]:
    """Report on the logs in a run's folder, beside them; returns the summary.

    Raises:
        LogError: there is no log, or none that can be read.
    """
    directory = Path(run_directory)
    logs = logs_in(directory)
    if not logs:
        raise LogError("there is no log in the folder", value=str(directory), remedy="give the folder of a run")
    return render(open_recording(logs), directory, figures=figures)


def render(
    recording: Recording, directory: str | Path, *, wall_s: float | None = None, figures: bool = True
) -> dict[str, Any]:
    """Write ``report.html``, ``summary.json`` and, with `figures`, ``figures/*.png`` into `directory`.

    `wall_s` is the wall time of the loop of a lockstep run, where it is known. Returns the summary.
    """
    directory = Path(directory)
    directory.mkdir(parents=True, exist_ok=True)
    summary = summaries.summarise(recording, wall_s)
    summaries.write(summary, directory)
    shown = []
    for name, title, caption, figure in draw(recording):
        shown.append(page.Picture(title, style.svg(figure), caption, figure.get_figheight()))
        if figures:
            (directory / "figures").mkdir(exist_ok=True)
            style.save(figure, directory / "figures" / f"{name}.png")
    (directory / "report.html").write_text(page.page(recording, summary, shown), encoding="utf-8")
    return summary


def draw(recording: Recording) -> list[tuple[str, str, str, Any]]:
    """The pictures there is something to show on: (name, title, caption, matplotlib figure)."""
    run = summaries.Run(recording)
    drawn = [
        ("force", "Force against depth", force.CAPTION, force.draw(run)),
        ("cochlea", "The array in the cochlea at five depths", cochlea_view.caption(run), cochlea_view.draw(run)),
        ("detection", "Prediction and failure detection", detection.CAPTION, detection.draw(run)),
        ("path", "Path of the gripper", path.CAPTION, path.draw(run)),
        ("motion", "Depth and stylet against time", motion.CAPTION, motion.draw(run)),
        ("timing", "How the loop kept time", timing.CAPTION, timing.draw(run)),
    ]
    return [(name, title, caption, figure) for name, title, caption, figure in drawn if figure is not None]
