"""The log of a run, which may fail without taking the gateway with it."""

import base64
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from hal.signals import Table
from rtctl.log.format import LogError
from rtctl.log.writer import LogWriter


def next_path(directory: Path) -> Path:
    """log.mcap, or the first of log-2.mcap, log-3.mcap ... that does not exist: a log is never overwritten."""
    path, number = directory / "log.mcap", 1
    while path.exists():
        number += 1
        path = directory / f"log-{number}.mcap"
    return path


class Journal:
    """Writes until the first error; then it keeps what was written and `failure` says what happened.

    Safe to call from several threads.
    """

    def __init__(self, path: Path, tables: dict[str, Table], header: dict[str, str], chunk_bytes: int) -> None:
        self.path, self.failure = path, ""
        self._lock = threading.Lock()
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            self._writer = LogWriter(path, tables, header, chunk_bytes=chunk_bytes)
        except (LogError, OSError) as error:
            self.failure = str(error)

    def rows(self, topic: str, rows: np.ndarray) -> bool:
        """Log records (n,) of the topic's table; False once the log has failed."""
        return self._attempt(lambda writer: writer.write_rows(topic, rows))

    def document(self, topic: str, time_ns: int, content: dict[str, Any]) -> bool:
        """Log one JSON message; False once the log has failed."""
        return self._attempt(lambda writer: writer.write_json(topic, time_ns, content))

    def flush(self) -> bool:
        """What was logged so far survives this process; False once the log has failed."""
        return self._attempt(lambda writer: writer.flush())

    @property
    def size_bytes(self) -> int:
        """Of the file. When it grows, all that was logged before the last call survives this process."""
        try:
            return self.path.stat().st_size
        except OSError:
            return 0

    def close(self) -> None:
        """Finish the file."""
        self._attempt(lambda writer: writer.close())

    def _attempt(self, action: Callable[[LogWriter], None]) -> bool:
        with self._lock:
            if not self.failure:
                try:
                    action(self._writer)
                except (LogError, OSError) as error:
                    self.failure = str(error)
            return not self.failure


def with_bytes(content: dict[str, Any], record: np.ndarray) -> dict[str, Any]:
    """A message that also carries the record (1,) bit for bit, so that a replay can feed exactly this."""
    return {**content, "record_base64": base64.b64encode(record.tobytes()).decode()}
