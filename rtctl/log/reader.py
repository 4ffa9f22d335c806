"""Opens logs, whole or cut short, old or new."""

import json
import mmap
from collections import defaultdict
from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple, Self

import numpy as np
from mcap.opcode import Opcode
from mcap.records import Metadata

from rtctl.log.format import (
    BLACKBOX,
    CONTROLLER,
    EVENTS,
    HASH,
    HEADER_NAME,
    PARAMETERS,
    PLANS,
    STRING_SCHEMA,
    TRUTH,
    LogError,
    decode_json,
    dtype_of,
)
from rtctl.log.scan import MESSAGE_HEAD, Definitions, Scan, parse
from rtctl.record import CDR_HEADER

ROW_START = MESSAGE_HEAD.size + len(CDR_HEADER)


class Message(NamedTuple):
    """One JSON message of a log."""

    time_ns: int
    payload: Any


@dataclass(frozen=True)
class Log:
    """A run, as it was recorded. Arrays are read-only, in the order of the file.

    Attributes:
        paths: the files it was read from.
        header: texts: ``settings`` (JSON), ``config_hash``, ``seed``, ``kernel_hash``, ``grade`` and more.
        rows: topic -> structured array, shape (n,), with the dtype the file itself describes.
        messages: topic -> JSON messages with their times.
        complete: the log was closed, and all of it is readable.
        size_bytes: of the files.
        lost_bytes: of the files, in no complete record.
    """

    paths: tuple[Path, ...]
    header: dict[str, str]
    rows: dict[str, np.ndarray]
    messages: dict[str, list[Message]]
    complete: bool
    size_bytes: int
    lost_bytes: int

    @classmethod
    def open(cls, path: str | Path) -> Self:
        """Read the log at `path`; one whose writer was killed gives every complete chunk.

        Raises:
            LogError: no such file, not a log of rtctl, or too short to hold even the header.
        """
        file = Path(path)
        data = mapped(file)
        scan = Scan(data)
        header, rows, messages = _read(scan, file)
        complete = scan.closed and not scan.lost_bytes
        return cls((file,), header, rows, messages, complete, len(data), scan.lost_bytes)

    @property
    def controller(self) -> np.ndarray:
        """All records of the controller.

        Raises:
            LogError: the log ends before the first of them.
        """
        if CONTROLLER not in self.rows:
            raise LogError(
                "the log holds no record of the controller", value=str(self.paths[0]), remedy="the run ended too early"
            )
        return self.rows[CONTROLLER]

    @property
    def truth(self) -> np.ndarray | None:
        """What the simulated plant knew, if this was a simulation."""
        return self.rows.get(TRUTH)

    @property
    def events(self) -> list[dict[str, Any]]:
        """What happened, in order."""
        return self._payloads(EVENTS)

    @property
    def parameters(self) -> list[dict[str, Any]]:
        """Parameter sets, in order."""
        return self._payloads(PARAMETERS)

    @property
    def plans(self) -> list[dict[str, Any]]:
        """Insertion plans, in order."""
        return self._payloads(PLANS)

    @property
    def blackboxes(self) -> list[dict[str, Any]]:
        """Black boxes of ticks over budget and of faults, in order; see :mod:`rtctl.gateway.blackbox`."""
        return self._payloads(BLACKBOX)

    @property
    def hashes(self) -> list[dict[str, Any]]:
        """One entry a second, see :mod:`rtctl.log.hashing`."""
        return self._payloads(HASH)

    def settings_table(self) -> dict[str, Any]:
        """The settings of the run, as :func:`rtctl.settings.from_table` takes them.

        Raises:
            LogError: the header has none.
        """
        if "settings" not in self.header:
            raise LogError("the log's header has no settings", value=sorted(self.header))
        return json.loads(self.header["settings"])

    def missing_ticks(self) -> list[tuple[int, int]]:
        """Ranges (first, last) of ticks that ran and are not in the log: skipped grid points are not among them."""
        rows = self.controller
        ticks = rows["tick"]
        first = ticks[:-1] + 1
        last = ticks[1:] - 1 - rows["missed_ticks"][1:]
        lost = last >= first
        return [(int(a), int(b)) for a, b in zip(first[lost], last[lost], strict=True)]

    def _payloads(self, topic: str) -> list[dict[str, Any]]:
        return [message.payload for message in self.messages.get(topic, [])]


def open_many(paths: Iterable[str | Path]) -> Log:
    """Join the logs of one run, in order: a restarted gateway goes on in a file of its own.

    Rows that two files hold (the ring was read again) are taken once.

    Raises:
        LogError: no paths, or the logs are not of one run.
    """
    logs = [Log.open(path) for path in paths]
    if not logs:
        raise LogError("no logs to join", remedy="give at least one file")
    whole = logs[0]
    for log in logs[1:]:
        for key in ("config_hash", "kernel_hash", "seed"):
            if log.header.get(key) != whole.header.get(key):
                raise LogError(
                    f"{log.paths[0]} is not of the same run: {key} differs",
                    value=log.header.get(key),
                    bound=str(whole.header.get(key)),
                )
        whole = replace(
            whole,
            paths=whole.paths + log.paths,
            rows={t: _joined(whole.rows.get(t), log.rows.get(t), t) for t in {**whole.rows, **log.rows}},
            messages={
                t: whole.messages.get(t, []) + log.messages.get(t, []) for t in {**whole.messages, **log.messages}
            },
            complete=whole.complete and log.complete,
            size_bytes=whole.size_bytes + log.size_bytes,
            lost_bytes=whole.lost_bytes + log.lost_bytes,
        )
    return whole


def mapped(path: Path) -> memoryview:
    """The bytes of a file without loading them.

    Raises:
        LogError: there is no such file, or it cannot be read.
    """
    try:
        with path.open("rb") as file:
            if path.stat().st_size == 0:
                return memoryview(b"")
            return memoryview(mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ))
    except OSError as error:
        raise LogError("cannot read the log", value=f"{path}: {error.strerror}") from error


def _read(scan: Scan, path: Path) -> tuple[dict[str, str], dict[str, np.ndarray], dict[str, list[Message]]]:
    """Header, rows and JSON messages of a file."""
    header: dict[str, str] | None = None
    definitions = Definitions()
    bodies: dict[int, list[memoryview]] = defaultdict(list)
    for opcode, body in scan:
        if opcode == Opcode.MESSAGE:
            bodies[body[0] | body[1] << 8].append(body)
        elif opcode == Opcode.METADATA and header is None:
            metadata = parse(Metadata, body)
            header = metadata.metadata if metadata.name == HEADER_NAME else None
        else:
            definitions.note(opcode, body)
    if header is None:
        raise LogError("not a log of rtctl, or cut short before its header", value=str(path))

    rows: dict[str, np.ndarray] = {}
    messages: dict[str, list[Message]] = {}
    for number, (channel, schema) in definitions.described().items():
        found = bodies.get(number, [])
        if schema.name == STRING_SCHEMA:
            messages[channel.topic] = [
                Message(MESSAGE_HEAD.unpack_from(b)[2], decode_json(bytes(b[MESSAGE_HEAD.size :]))) for b in found
            ]
        else:
            dtype = dtype_of(schema.data.decode())
            if any(len(b) != ROW_START + dtype.itemsize for b in found):
                raise LogError(f"rows of {channel.topic} do not fit their description", bound=f"{dtype.itemsize} bytes")
            rows[channel.topic] = np.frombuffer(b"".join(b[ROW_START:] for b in found), dtype)
    return header, rows, messages


def _joined(first: np.ndarray | None, second: np.ndarray | None, topic: str) -> np.ndarray:
    """Rows of two files of one run, none twice."""
    if first is None or second is None or not len(first) or not len(second):
        joined = second if first is None or not len(first) else first
        assert joined is not None
        return joined
    if first.dtype != second.dtype:
        raise LogError(f"the logs are not of the same run: rows of {topic} differ in their fields")
    joined = np.concatenate([first, second[second["time_ns"] > first["time_ns"][-1]]])
    joined.flags.writeable = False
    return joined
