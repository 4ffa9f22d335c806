"""One finished capture."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from hal.signals import Signal


@dataclass(frozen=True)
class Capture:
    """Samples around a trigger.

    Attributes:
        number: 0 for the first of its scope.
        rows: samples (n,): ``time_ns``, ``tick``, ``missed``, ``lost`` and the signals by the names they were asked for.
        signals: what these signals are, with units and frames.
        trigger: what was waited for, in words.
        cause: ``trigger``, ``forced`` or ``auto``.
        trigger_tick, trigger_time_ns: when it fired.
        trigger_index: the first sample at or after that tick.
        decimation: ticks from one sample to the next.
        complete: it has all its samples; not so when the records ended before.
    """

    number: int
    rows: np.ndarray
    signals: tuple[Signal, ...]
    trigger: str
    cause: str
    trigger_tick: int
    trigger_time_ns: int
    trigger_index: int
    decimation: int
    complete: bool = True

    def __len__(self) -> int:
        return len(self.rows)

    def __getitem__(self, name: str) -> np.ndarray:
        """Values of one signal, shape (n,) or (n, k)."""
        return self.rows[name]

    @property
    def time_s(self) -> np.ndarray:
        """Time (n,) of every sample since the trigger [s]."""
        return (self.rows["time_ns"].astype(np.int64) - self.trigger_time_ns) * 1e-9

    @property
    def units(self) -> dict[str, str]:
        """Signal -> unit; empty where it has none."""
        return {s.name: s.unit for s in self.signals}

    @property
    def missed_ticks(self) -> int:
        """Grid points the loop skipped inside the capture."""
        return int(self.rows["missed"].sum())

    @property
    def lost_records(self) -> int:
        """Ticks inside the capture that ran but whose records were lost."""
        return int(self.rows["lost"].sum())

    def facts(self) -> dict[str, Any]:
        """Everything but rows and signals, as plain values."""
        names = (
            "number",
            "trigger",
            "cause",
            "trigger_tick",
            "trigger_time_ns",
            "trigger_index",
            "decimation",
            "complete",
        )
        return {name: getattr(self, name) for name in names}

    def save(self, path: str | Path) -> None:
        """Write it to a new file, see :func:`rtctl.scope.files.save`."""
        from rtctl.scope.files import save

        save([self], path)
