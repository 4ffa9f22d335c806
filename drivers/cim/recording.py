"""Recordings of raw datagrams: a file of times and bytes, written beside the tick.

    8 bytes  "CIMREC1\\n"
    then, for every datagram, big-endian:
    u64      time since the beginning of the recording [us]
    u16      length n
    n bytes  the datagram as it came

A file that ends within a datagram was cut off by the end of its process; what is whole before that is good.
"""

import queue
import struct
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO

from hal.errors import BackendError

MAGIC = b"CIMREC1\n"
HEAD = struct.Struct(">QH")
WAITING_MAX = 10_000
"""Datagrams that may wait for a slow disk; more are not recorded."""


def read(path: Path) -> Iterator[tuple[int, bytes]]:
    """Time [us] and bytes of every whole datagram. Raises BackendError."""
    try:
        data = path.read_bytes()
    except OSError as error:
        raise BackendError("the recording cannot be read", value=str(path), remedy=str(error.strerror)) from None
    if not data.startswith(MAGIC):
        raise BackendError("this is no recording of telemetry", value=str(path), remedy="make one with record_to in the device's settings, or with `python -m drivers.cim.relay --record`")  # fmt: skip
    return _records(data)


def _records(data: bytes) -> Iterator[tuple[int, bytes]]:
    at = len(MAGIC)
    while at + HEAD.size <= len(data):
        time_us, length = HEAD.unpack_from(data, at)
        at += HEAD.size
        if at + length > len(data):
            return
        yield time_us, data[at : at + length]
        at += length


class Recorder:
    """Writes a new recording into a directory, in a thread of its own: the disk may take its time, and the tick may not.

    Attributes:
        path: of the recording. lost: datagrams that were not recorded, because the disk is full or too slow.
    """

    def __init__(self, directory: str, name: str) -> None:
        """Begin NAME-0001.cimrec, or the next number there is not yet. Raises BackendError."""
        self.lost = 0
        self._queue: queue.SimpleQueue[bytes | None] = queue.SimpleQueue()
        self.path, self._file = _create(Path(directory), name)
        self._thread = threading.Thread(target=self._write, name=f"record {name}", daemon=True)
        self._thread.start()

    def note(self, time_us: int, data: memoryview) -> None:
        """Record a datagram that came `time_us` after the beginning. Never waits."""
        if self._queue.qsize() < WAITING_MAX:
            self._queue.put(HEAD.pack(time_us, len(data)) + data)
        else:
            self.lost += 1

    def close(self) -> None:
        """Write what waits, and close the file. May be called twice."""
        self._queue.put(None)
        self._thread.join()

    def _write(self) -> None:
        with self._file:
            while (record := self._queue.get()) is not None:
                try:
                    self._file.write(record)
                except OSError:
                    self.lost += 1


def _create(directory: Path, name: str) -> tuple[Path, BinaryIO]:
    """The next file there is not yet, unbuffered, so that a process that dies loses nothing it had noted."""
    try:
        for number in range(1, 10_000):
            path = directory / f"{name}-{number:04d}.cimrec"
            if not path.exists():
                file = path.open("xb", buffering=0)
                file.write(MAGIC)
                return path, file
    except OSError as error:
        raise BackendError("no recording can be made", value=str(directory), remedy=f"record_to must be a directory that may be written to ({error.strerror})") from None  # fmt: skip
    raise BackendError("no recording can be made", value=str(directory), bound="9999 recordings", remedy="move the old ones away")  # fmt: skip
