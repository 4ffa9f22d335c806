"""Replays of every run below a folder, side by side; one that cannot be read does not stop the others."""

import os
from collections.abc import Callable, Generator
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any

from hal.errors import RtctlError
from rtctl import replay
from rtctl.campaign.workers import results_of
from rtctl.log.reader import LogError
from rtctl.recording import logs_in
from rtctl.replaying.difference import Difference

Run = tuple[Path, ...]
"""The log files of one run, in order."""


@dataclass(frozen=True)
class Outcome:
    """What came of the replay of one run; `error` says why there was none."""

    run: str
    ticks: int | None = None
    commands: int | None = None
    difference: Difference | None = None
    same_kernels: bool | None = None
    not_compared: tuple[str, ...] = ()
    error: str = ""

    @property
    def good(self) -> bool:
        """Identical to the bit."""
        return not self.error and self.difference is None

    @property
    def verdict(self) -> str:
        """One word: identical, different or unreadable."""
        return "identical" if self.good else "unreadable" if self.error else "different"

    def as_table(self) -> dict[str, Any]:
        """Plain values for JSON."""
        return {"run": self.run, "result": self.verdict, **{k: v for k, v in asdict(self).items() if k != "run"}}


def runs_below(directory: Path) -> list[Run]:
    """Every run in `directory` and below: the logs of a daemon's folder together, any other log by itself.

    Raises:
        LogError: there is no such folder, or no log in it.
    """
    if not directory.is_dir():
        raise LogError("there is no such folder", value=str(directory))
    runs: list[Run] = []
    for folder in sorted({file.parent for file in directory.rglob("*.mcap")}):
        together = logs_in(folder)
        runs += [tuple(together)] if together else []
        runs += [(file,) for file in sorted(folder.glob("*.mcap")) if file not in together]
    if not runs:
        raise LogError("no log in this folder or below", value=str(directory))
    return runs


def name_of(run: Run, directory: Path) -> str:
    """What a run is called in a table: its folder, or its file where that is not ``log.mcap``."""
    first = run[0].relative_to(directory)
    return str(first.parent) if first.stem == "log" and first.parent != Path() else str(first)


def replay_run(directory: Path, run: Run) -> Outcome:
    """Replay one run; whatever is wrong with it is in the outcome."""
    name = name_of(run, directory)
    try:
        found = replay.run(run)
    except RtctlError as error:
        return Outcome(name, error=str(error))
    except Exception as error:  # a damaged log can break a reader anywhere, and there are other logs
        return Outcome(name, error=f"{type(error).__name__}: {error}")
    return Outcome(name, found.ticks, found.commands, found.difference, found.same_kernels, found.not_compared)


def replay_all(runs: list[Run], directory: Path, jobs: int | None = None) -> Generator[Outcome, None, None]:
    """Outcomes of `runs` below `directory`, in their order; close it to end the processes.

    Args:
        jobs: processes; as many as there are cores for us by default.

    Raises:
        CampaignError: a process was killed.
    """
    one: Callable[[Run], Outcome] = partial(replay_run, directory)
    return results_of(one, runs, jobs or len(os.sched_getaffinity(0)))
