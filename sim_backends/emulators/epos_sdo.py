"""SDO server of an emulated node: expedited transfers, since no object here is longer than four bytes (07 section 2.3)."""

import struct
from collections.abc import Callable

from sim_backends.emulators.epos_objects import (
    ABORT_LENGTH,
    ABORT_NO_OBJECT,
    ABORT_NO_SUBINDEX,
    ABORT_RANGE,
    ABORT_READ_ONLY,
    Abort,
    Entry,
    key,
)

UNKNOWN_COMMAND = 0x05040001
DOWNLOAD, UPLOAD = 1, 2
EXPEDITED, SIZE_TOLD = 0x02, 0x01


class SdoServer:
    """A server that asks `check` (index, sub-index, value; raises Abort) before it writes, and tells `written` (index) after.

    Attributes:
        objects: what it serves.
        refused, distorted: index of an object whose transfers are aborted, and of one that reads back wrong; 0 for none.
    """

    def __init__(self, check: Callable[[int, int, int], None], written: Callable[[int], None]) -> None:
        self.objects: dict[int, Entry] = {}
        self._check, self._written = check, written
        self.refused = self.distorted = 0

    def answer(self, request: bytes) -> bytes:
        """Reply to a request of eight bytes."""
        command, index, sub = struct.unpack_from("<BHB", request)
        try:
            if command >> 5 == UPLOAD:
                data = self._read(index, sub)
                return struct.pack("<BHB4s", 0x43 | (4 - len(data)) << 2, index, sub, data)
            if command >> 5 == DOWNLOAD and command & EXPEDITED:
                size = 4 - (command >> 2 & 3) if command & SIZE_TOLD else 4
                self._write(index, sub, request[4 : 4 + size])
                return struct.pack("<BHB4x", 0x60, index, sub)
            raise Abort(UNKNOWN_COMMAND)
        except Abort as abort:
            return struct.pack("<BHBI", 0x80, index, sub, abort.code)

    def _find(self, index: int, sub: int) -> Entry:
        if index == self.refused:
            raise Abort(ABORT_RANGE)
        entry = self.objects.get(key(index, sub))
        if entry is None:
            raise Abort(ABORT_NO_SUBINDEX if key(index) in self.objects else ABORT_NO_OBJECT)
        return entry

    def _read(self, index: int, sub: int) -> bytes:
        data = bytearray(self._find(index, sub).pack())
        if index == self.distorted:
            data[0] ^= 1
        return bytes(data)

    def _write(self, index: int, sub: int, data: bytes) -> None:
        entry = self._find(index, sub)
        if not entry.writable:
            raise Abort(ABORT_READ_ONLY)
        if len(data) != entry.size:
            raise Abort(ABORT_LENGTH)
        (value,) = struct.unpack("<" + entry.code, data)
        self._check(index, sub, value)
        entry.value = value
        self._written(index)
