"""Many insertions in one go: progress, and what they came to."""

import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from rtctl.cli.console import remark, say, side
from rtctl.cli.exit_codes import Exit

if TYPE_CHECKING:
    from collections.abc import Callable

    from rtctl.campaign import Standing
    from rtctl.settings import Settings

LINE_S = 10.0
"""Time between two lines of progress where there is no terminal."""


def run(settings: "Settings", seed: int, count: int, jobs: int, file: Path, logs: Path | None) -> Exit:
    """Carry out a campaign and tell how it goes; failed insertions are rows, not a failure of the command."""
    from rtctl import campaign

    pace = Pace()
    try:
        with shown(pace) as report:
            campaign.run(settings, range(seed, seed + count), file, jobs, report, logs)
    except KeyboardInterrupt:
        if pace.now is not None:
            remark(f"rtctl: {pace.now.done} of {count} rows are in {file}; the same command goes on from there")
        raise
    assert pace.now is not None
    say(f"{count} rows in {file}, {pace.now.failed} of them not completed; {pace.added} new, {pace.rate():.2f} rows/s")
    return Exit.OK


class Pace:
    """How fast a campaign goes, counted from the first row that was not there before."""

    def __init__(self) -> None:
        self.now: Standing | None = None
        self._start_s, self._start_done = 0.0, 0

    def see(self, standing: "Standing") -> None:
        """Take note of where the campaign is."""
        if self.now is None:
            self._start_s, self._start_done = time.monotonic(), standing.done
        self.now = standing

    @property
    def added(self) -> int:
        """Rows written by this command."""
        return 0 if self.now is None else self.now.done - self._start_done

    def rate(self) -> float:
        """Rows a second."""
        return self.added / max(time.monotonic() - self._start_s, 1e-9)

    def reading(self) -> str:
        """Failures, rate and time left in words."""
        assert self.now is not None
        words = f"{self.now.failed} not completed, {self.rate():.2f} rows/s"
        if not self.added:
            return words
        left_s = (self.now.total - self.now.done) / self.rate()
        return f"{words}, {_duration(left_s)} left"


@contextmanager
def shown(pace: Pace) -> "Iterator[Callable[[Standing], None]]":
    """Progress on the side channel, as a bar where there is a terminal; yields what is to be called with each standing."""
    if side().is_terminal:
        with _bar(pace) as report:
            yield report
    else:
        yield _Lines(pace)


class _Lines:
    """A line at the start, at the end, and every so often in between."""

    def __init__(self, pace: Pace) -> None:
        self._pace, self._told_s = pace, -LINE_S

    def __call__(self, standing: "Standing") -> None:
        self._pace.see(standing)
        now_s = time.monotonic()
        if now_s - self._told_s >= LINE_S or standing.done == standing.total:
            self._told_s = now_s
            remark(f"{standing.done:6d}/{standing.total} insertions, {self._pace.reading()}")


@contextmanager
def _bar(pace: Pace) -> "Iterator[Callable[[Standing], None]]":
    from rich import progress as rich_progress

    bar = rich_progress.Progress(
        rich_progress.SpinnerColumn(finished_text="[green]✓"),
        rich_progress.TextColumn("insertions"),
        rich_progress.BarColumn(bar_width=28),
        rich_progress.MofNCompleteColumn(),
        rich_progress.TextColumn("[dim]{task.fields[reading]}"),
        console=side(),
    )
    task = bar.add_task("insertions", total=None, reading="")

    def report(standing: "Standing") -> None:
        pace.see(standing)
        bar.update(task, total=standing.total, completed=standing.done, reading=pace.reading())

    with bar:
        yield report


def _duration(seconds: float) -> str:
    """A time to wait, as short as it may be read."""
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours} h {minutes:02d} min" if hours else f"{minutes} min {rest:02d} s" if minutes else f"{rest} s"
