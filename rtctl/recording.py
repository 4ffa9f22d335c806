"""A run as it was recorded, whether it comes from a log or straight from lockstep: what summary and report are made of."""

import base64
import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from rtctl.electrode.path import PATH
from rtctl.gateway.events import Watcher
from rtctl.lifecycle import Task
from rtctl.log.reader import Log, open_many
from rtctl.settings import Settings, from_table


@dataclass(frozen=True)
class Recording:
    """One run.

    Attributes:
        settings: that the run was started with.
        header: texts of the log's header.
        records: controller records (n,), n >= 1.
        truths: what the plant knew (m,), None on hardware. Fields may be missing: every plant tells its own.
        events: the operator's diary, in order.
        plan: the last insertion plan loaded, (1,) of dtype PATH.
        lost_records: ticks that ran and are not in `records`.
        complete: it comes from a log that was closed and is readable to the end, or straight from memory.
    """

    settings: Settings
    header: Mapping[str, str]
    records: np.ndarray
    truths: np.ndarray | None
    events: list[dict[str, Any]]
    plan: np.ndarray | None
    lost_records: int
    complete: bool

    @property
    def time_s(self) -> np.ndarray:
        """Time (n,) of every record since the first [s]."""
        return (self.records["time_ns"] - self.records["time_ns"][0]) * 1e-9

    @property
    def drawn(self) -> dict[str, float]:
        """What the seed decided about a simulated bench, by names with units; empty for the daemon's runs."""
        return json.loads(self.header.get("drawn", "{}"))

    @property
    def dof(self) -> int:
        """Number of pose coordinates."""
        return int(self.records["pose_measured"].shape[1])

    @cached_property
    def insertion(self) -> np.ndarray:
        """Which records (n,) belong to the insertion proper."""
        return self.records["task_state"] == Task.INSERTING

    @cached_property
    def paired(self) -> tuple[np.ndarray, np.ndarray] | None:
        """Records and truths of the ticks that have both, both (k,); None without truths."""
        if self.truths is None or not len(self.truths):
            return None
        _, i, j = np.intersect1d(self.records["tick"], self.truths["tick"], assume_unique=True, return_indices=True)
        return self.records[i], self.truths[j]


def from_log(log: Log) -> Recording:
    """The run in an opened log.

    Raises:
        LogError: the log has no settings or no record.
    """
    records, settings = log.controller, from_table(log.settings_table())
    plans = [plan["record_base64"] for plan in log.plans if "record_base64" in plan]
    return Recording(
        settings=settings,
        header=log.header,
        records=records,
        truths=log.truth,
        events=log.events or diary(records, settings.backend.device_names),
        plan=np.frombuffer(base64.b64decode(plans[-1]), PATH) if plans else None,
        lost_records=sum(last - first + 1 for first, last in log.missing_ticks()),
        complete=log.complete,
    )


def open_recording(paths: Iterable[str | Path]) -> Recording:
    """The run in the log files at `paths`, in order: a restarted gateway begins a new one.

    Raises:
        LogError: not logs of one run.
    """
    return from_log(open_many(paths))


def logs_in(directory: Path) -> list[Path]:
    """The log files of a run's folder, in the order in which they were written."""
    found = directory.glob("log*.mcap")
    return sorted(found, key=lambda p: (len(p.stem), p.stem))


def diary(records: np.ndarray, devices: Sequence[str] = ()) -> list[dict[str, Any]]:
    """The events of controller records (n,), as the gateway would have told them of these devices."""
    return [msgspec.to_builtins(event) for event in Watcher(devices).watch(records)]
