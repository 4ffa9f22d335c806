"""Writes the log of a run while it happens, so that whatever ends the run leaves a readable file."""

from collections.abc import Mapping
from pathlib import Path
from types import TracebackType
from typing import Any, Literal, Self

import numpy as np
from mcap.writer import CompressionType, IndexType, Writer

from hal.signals import Table
from rtctl.log.format import (
    CONTROLLER,
    HASH,
    HEADER_NAME,
    JSON_TOPICS,
    PROFILE,
    ROW_SCHEMA,
    STRING_MESSAGE,
    STRING_SCHEMA,
    LogError,
    encode_json,
)
from rtctl.log.hashing import OutputHash, split_seconds
from rtctl.record import CDR_HEADER

LIBRARY = "rtctl"
"""Fixed, so that a file tells the experiment and not the installation."""

FLUSH_NS = 500_000_000
"""A chunk spans no more time than this, so a slow log is not lost with the process."""

NEVER = 2**62
"""Chunk size of the library: it shall not begin chunks on its own."""


class _Sink:
    """An unbuffered file that writes all or raises: what was passed on belongs to the system, not to the process."""

    def __init__(self, path: Path) -> None:
        self._file = path.open("xb", buffering=0)
        self._position = 0

    def write(self, data: bytes) -> None:
        view = memoryview(data)
        while view:
            written = self._file.write(view)
            self._position += written
            view = view[written:]

    def tell(self) -> int:
        return self._position

    def flush(self) -> None:
        """Nothing is held back."""

    def close(self) -> None:
        self._file.close()


class LogWriter:
    """An MCAP file of one run.

    The bytes depend on what is written and in which order, never on the wall clock or on how the rows of a topic
    are batched. A killed process loses at most the chunk under way. When the file cannot be written any more
    (disk full), one LogError is raised; from then on `failed` is true and everything offered is only counted.

    Args:
        path: the file; it must not exist.
        tables: topic -> table of its rows; rows of ``/controller`` are hashed second by second.
        header: what is needed to run the experiment again, all texts. Readers know ``settings`` (JSON of the
            settings table), ``config_hash``, ``seed``, ``kernel_hash`` and ``grade``.
        chunk_bytes: size of a chunk before compression, bytes.
        compression: of the chunks.
        message_index: viewers that jump to a time want it; it takes 16 bytes a row.

    Raises:
        LogError: the file exists or cannot be written.
    """

    def __init__(
        self,
        path: str | Path,
        tables: Mapping[str, Table],
        header: Mapping[str, str],
        *,
        chunk_bytes: int = 192 * 1024,
        compression: Literal["zstd", "none"] = "zstd",
        message_index: bool = True,
    ) -> None:
        self.path = Path(path)
        self.failed = False
        self._closed = False
        self._chunk_bytes = chunk_bytes
        self._pending_bytes = 0
        self._chunk_start_ns = 0
        self._offered = self._accepted = self._stored = 0
        self._dtypes = {topic: table.dtype for topic, table in tables.items()}
        self._hash = OutputHash(self._dtypes[CONTROLLER]) if CONTROLLER in tables else None
        self._last_ns = 0
        try:
            self._sink = _Sink(self.path)
        except FileExistsError:
            raise LogError(
                "there is a log of that name", value=str(path), remedy="choose another name; logs are not overwritten"
            ) from None
        except OSError as error:
            raise LogError("cannot create the log", value=f"{path}: {error.strerror}") from error
        self._writer = Writer(self._sink, chunk_size=NEVER, compression=CompressionType[compression.upper()], index_types=IndexType.ALL if message_index else IndexType.NONE)  # type: ignore[arg-type]  # fmt: skip
        try:
            self._writer.start(profile=PROFILE, library=LIBRARY)
            self._writer.add_metadata(HEADER_NAME, dict(header))
        except OSError as error:
            raise self._fail(error) from error
        self._channels = {}
        for topic, table in tables.items():
            schema = self._writer.register_schema(ROW_SCHEMA.format(table.name), "ros2msg", table.message.encode())
            self._channels[topic] = self._writer.register_channel(topic, "cdr", schema)
        self._string = self._writer.register_schema(STRING_SCHEMA, "ros2msg", STRING_MESSAGE.encode())
        for topic in JSON_TOPICS:
            self._channels[topic] = self._writer.register_channel(topic, "cdr", self._string)

    @property
    def dropped(self) -> int:
        """Rows and messages that were offered and will never be in the file; 0 unless `failed`."""
        return self._offered - self._stored if self.failed else 0

    def write_rows(self, topic: str, rows: np.ndarray) -> None:
        """Append `rows`, shape (n,), of the topic's table.

        Raises:
            LogError: once, when the file cannot be written any more.
        """
        self._offered += len(rows)
        if self.failed or not len(rows):
            return
        if rows.dtype != self._dtypes[topic]:
            raise ValueError(f"rows of {topic} must have the dtype of its table")
        if topic != CONTROLLER or self._hash is None:
            self._put_rows(topic, rows)
            return
        for piece in split_seconds(rows):
            self._put_hash(self._hash.add(piece))
            self._put_rows(topic, piece)
            self._last_ns = int(piece["time_ns"][-1])

    def write_json(self, topic: str, time_ns: int, payload: Any) -> None:
        """Append one message of plain Python values; a topic is opened by its first message.

        Raises:
            LogError: once, when the file cannot be written any more.
        """
        self._offered += 1
        if self.failed:
            return
        if topic not in self._channels:
            self._channels[topic] = self._writer.register_channel(topic, "cdr", self._string)
        data = encode_json(payload)
        self._accepted += 1
        self._put(self._channels[topic], time_ns, data)

    def flush(self) -> None:
        """End the chunk under way and hand it to the system; for a writer that has nothing to say for a while.

        Raises:
            LogError: once, when the file cannot be written any more.
        """
        if self.failed or self._closed:
            return
        try:
            self._writer.flush()
        except OSError as error:
            raise self._fail(error) from error
        self._pending_bytes = 0
        self._stored = self._accepted

    def close(self) -> None:
        """Write the last hash, the index and the footer; calling it again does nothing.

        Raises:
            LogError: the end could not be written; what came before stays readable.
        """
        if self.failed or self._closed:
            return
        if self._hash is not None:
            self._put_hash(self._hash.finish())
        self.flush()
        try:
            self._writer.finish()
            self._sink.close()
        except OSError as error:
            raise self._fail(error) from error
        self._closed = True

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _put_rows(self, topic: str, rows: np.ndarray) -> None:
        channel, size, data = self._channels[topic], rows.dtype.itemsize, rows.tobytes()
        for i, time_ns in enumerate(rows["time_ns"].tolist()):
            self._accepted += 1
            self._put(channel, time_ns, CDR_HEADER + data[i * size : (i + 1) * size])

    def _put_hash(self, entry: dict[str, Any] | None) -> None:
        if entry is not None:
            self._put(self._channels[HASH], self._last_ns, encode_json(entry))

    def _put(self, channel: int, time_ns: int, data: bytes) -> None:
        if self._closed:
            raise ValueError("the log is closed")
        if not self._pending_bytes:
            self._chunk_start_ns = time_ns
        self._writer.add_message(channel, log_time=time_ns, data=data, publish_time=time_ns)
        self._pending_bytes += len(data)
        if self._pending_bytes >= self._chunk_bytes or time_ns - self._chunk_start_ns >= FLUSH_NS:
            self.flush()

    def _fail(self, error: OSError) -> LogError:
        self.failed = True
        self._sink.close()
        return LogError(
            "the log cannot be written any more",
            value=f"{self.path}: {error.strerror}",
            remedy="make room on the disk; what is written so far can be read, or made whole by `rtctl log recover`",
        )
