"""Progress of a scripted insertion: bars on a terminal, one line a step anywhere else."""

import math
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from rtctl.cli.console import remark, side

if TYPE_CHECKING:
    from collections.abc import Callable

    from rtctl.workflow import Progress


@contextmanager
def shown(quiet: bool = False) -> "Iterator[Callable[[Progress], None]]":
    """A function to call with every :class:`rtctl.workflow.Progress`."""
    if quiet:
        yield lambda _: None
    elif side().is_terminal:
        with _bars() as report:
            yield report
    else:
        yield Lines()


def reading(progress: "Progress") -> str:
    """Depth and force in words, where there are any yet."""
    if progress.depth_mm <= 0.0:
        return ""
    force = "" if math.isnan(progress.force_n) else f", {1e3 * progress.force_n:.0f} mN"
    return f"{progress.depth_mm:.1f} mm{force}"


class Lines:
    """One line when a step begins, and one for every third millimetre of depth."""

    PART_MM = 3.0

    def __init__(self) -> None:
        self._step, self._told_mm = -1, 0.0

    def __call__(self, progress: "Progress") -> None:
        if progress.index != self._step:
            self._step = progress.index
            remark(f"{progress.time_s:7.2f} s  {progress.index + 1:2d}/{progress.count} {progress.name}")
        elif abs(progress.depth_mm - self._told_mm) >= self.PART_MM:
            self._told_mm = round(progress.depth_mm / self.PART_MM) * self.PART_MM
            remark(f"{progress.time_s:7.2f} s        {reading(progress)}")


@contextmanager
def _bars() -> "Iterator[Callable[[Progress], None]]":
    from rich import progress as rich_progress

    bars = rich_progress.Progress(
        rich_progress.SpinnerColumn(finished_text="[green]✓"),
        rich_progress.TextColumn("{task.description:<20}"),
        rich_progress.BarColumn(bar_width=28),
        rich_progress.TextColumn("{task.fields[reading]}"),
        rich_progress.TextColumn("[dim]{task.fields[time]}"),
        console=side(),
    )
    tasks: dict[int, Any] = {}

    def report(progress: "Progress") -> None:
        if progress.index not in tasks:
            for task in tasks.values():
                bars.update(task, completed=1.0)
            tasks[progress.index] = bars.add_task(progress.name, total=1.0, reading="", time="")
        bars.update(
            tasks[progress.index],
            completed=progress.fraction,
            reading=reading(progress),
            time=f"{progress.time_s:.1f} s",
        )

    with bars:
        yield report
