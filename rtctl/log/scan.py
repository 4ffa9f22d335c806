"""Walks through an MCAP file record by record, whatever has happened to it.

A seeking reader needs the footer, which a killed process never writes. This one goes from the start, believes rows and
their description only where a checksum holds, and where the framing is broken looks for the next whole chunk.
"""

import re
import struct
import zlib
from collections.abc import Iterator
from io import BytesIO
from typing import TypeVar

import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Channel, Metadata, Schema
from mcap.writer import MCAP0_MAGIC as MAGIC

Textual = TypeVar("Textual", Metadata, Schema, Channel)

FRAME = struct.Struct("<BQ")
CHUNK_HEAD = struct.Struct("<QQQII")
MESSAGE_HEAD = struct.Struct("<HIQQ")
FOOTER = struct.Struct("<BQQQI8s")
FOOTER_LENGTH = 20
LARGEST_CHUNK_BYTES = 256 * 1024 * 1024

CHUNK_START = re.compile(rb"(?=\x06.{36}(?:\x04\x00\x00\x00zstd|\x00\x00\x00\x00))", re.DOTALL)
"""Opcode, length, times, size and checksum, then the name of the compression with its length."""


class Scan:
    """The records of a file that can be trusted: metadata, what is in chunks, and what is in the summary.

    Iterating gives (opcode, body); afterwards `kept_bytes` tells how much of the file was understood and
    `closed` whether it ends with a sound summary and footer.
    """

    def __init__(self, data: bytes | memoryview) -> None:
        self._data = memoryview(data)
        self.kept_bytes = 0
        self.closed = False

    @property
    def lost_bytes(self) -> int:
        """Bytes of the file that belong to no sound record."""
        return max(0, len(self._data) - self.kept_bytes)

    def __iter__(self) -> Iterator[tuple[int, memoryview]]:
        data = self._data
        position = self.kept_bytes = len(MAGIC) if data[: len(MAGIC)] == MAGIC else 0
        settled = position  # end of the last chunk whose checksum held
        while position < len(data):
            found = self._record_at(position)
            if found is None:
                # A wrong length may have led past whole chunks: look again from where all was well.
                position = self._next_chunk(settled)
                continue
            opcode, contents, end = found
            self.kept_bytes += end - position
            position = end
            if opcode == Opcode.METADATA:
                yield opcode, contents
            elif opcode == Opcode.CHUNK:
                settled = end
                yield from _inside(contents)
            elif opcode == Opcode.DATA_END:
                self.closed = True
                yield from _inside(contents)

    def _record_at(self, position: int) -> tuple[int, memoryview, int] | None:
        """Opcode, contents and end of the sound record at `position`; None if there is none.

        The contents of the end of data are the summary, and its end is that of the file.
        """
        data = self._data
        if position + FRAME.size > len(data):
            return None
        opcode, length = FRAME.unpack_from(data, position)
        end = position + FRAME.size + length
        body = data[position + FRAME.size : end]
        contents: memoryview | None = None
        if end > len(data):
            return None
        if opcode == Opcode.CHUNK:
            contents = chunk_contents(body)
        elif opcode == Opcode.METADATA and _is_metadata(body):
            contents = body
        elif opcode == Opcode.HEADER or (opcode == Opcode.MESSAGE_INDEX and _is_index(body)):
            contents = body[:0]
        elif opcode == Opcode.DATA_END:
            contents, end = _summary(data[end:]), len(data)
        return None if contents is None else (opcode, contents, end)

    def _next_chunk(self, start: int) -> int:
        """Where the next whole chunk begins, or the end of the file."""
        for match in CHUNK_START.finditer(self._data, start):
            if self._record_at(match.start()) is not None:
                return match.start()
        return len(self._data)


def chunk_contents(body: memoryview) -> memoryview | None:
    """What is in a chunk, or None if it is damaged."""
    try:
        _, _, size, checksum, name_bytes = CHUNK_HEAD.unpack_from(body)
        start = CHUNK_HEAD.size + name_bytes + 8
        compression = bytes(body[CHUNK_HEAD.size : start - 8])
        (stored_bytes,) = struct.unpack_from("<Q", body, start - 8)
        stored = body[start:]
        if len(stored) != stored_bytes or size > LARGEST_CHUNK_BYTES:
            return None
        if compression == b"zstd":
            # The frame tells its own size; a damaged one could ask for all the memory there is.
            if zstandard.get_frame_parameters(stored).content_size != size:
                return None
            stored = memoryview(zstandard.decompress(stored))
        elif compression:
            return None
    except (struct.error, zstandard.ZstdError):
        return None
    return stored if zlib.crc32(stored) == checksum else None


def parse(kind: type[Textual], body: memoryview) -> Textual:
    """The record of that kind in a `body` that was found sound."""
    return kind.read(ReadDataStream(BytesIO(body)))


class Definitions:
    """Schemas and channels as they turn up; the summary repeats what a damaged chunk may have held."""

    def __init__(self) -> None:
        self.schemas: dict[int, Schema] = {}
        self.channels: dict[int, Channel] = {}

    def note(self, opcode: int, body: memoryview) -> None:
        """Take the record if it defines something."""
        if opcode == Opcode.SCHEMA:
            schema = parse(Schema, body)
            self.schemas[schema.id] = schema
        elif opcode == Opcode.CHANNEL:
            channel = parse(Channel, body)
            self.channels[channel.id] = channel

    def described(self) -> dict[int, tuple[Channel, Schema]]:
        """Channel number -> channel and schema, where both are known."""
        return {i: (c, self.schemas[c.schema_id]) for i, c in self.channels.items() if c.schema_id in self.schemas}


def _is_metadata(body: memoryview) -> bool:
    stream = ReadDataStream(BytesIO(body))
    try:
        Metadata.read(stream)
    except (McapError, struct.error, UnicodeDecodeError):
        return False
    return stream.count == len(body)


def _is_index(body: memoryview) -> bool:
    """Whether the length of a message index agrees with itself: a wrong one would hide what follows."""
    return len(body) >= 6 and len(body) == 6 + struct.unpack_from("<I", body, 2)[0]


def _summary(rest: memoryview) -> memoryview | None:
    """The records between the end of the data and the footer, or None if their checksum does not hold."""
    if len(rest) < FOOTER.size:
        return None
    opcode, length, _, _, checksum, magic = FOOTER.unpack_from(rest, len(rest) - FOOTER.size)
    covered = rest[: len(rest) - len(MAGIC) - 4]
    if (opcode, length, magic) != (Opcode.FOOTER, FOOTER_LENGTH, MAGIC) or zlib.crc32(covered) != checksum:
        return None
    return rest[: len(rest) - FOOTER.size]


def _inside(contents: memoryview) -> Iterator[tuple[int, memoryview]]:
    """Records of a part of the file whose checksum held."""
    position = 0
    while position < len(contents):
        opcode, length = FRAME.unpack_from(contents, position)
        start = position + FRAME.size
        position = start + length
        yield opcode, contents[start:position]
