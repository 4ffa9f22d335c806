"""Process data of an emulated node: mappings that may only be changed in the right order (07 section 2.3)."""

import struct
from collections.abc import Callable

from sim_backends.emulators.epos_objects import (
    ABORT_NOT_MAPPABLE,
    ABORT_PDO_LENGTH,
    ABORT_STATE,
    INVALID_COB,
    PDOS,
    Abort,
    Entry,
    key,
)

SYNCHRONOUS = range(0xF1)
CONTROLWORD = key(0x6040)


class Pdo:
    """One process data object, compiled from its mapping when its COB-ID becomes valid.

    synchronous: taken over or sent at a SYNC; else at once.
    """

    __slots__ = ("codes", "entries", "has_controlword", "identifier", "kind", "last", "synchronous", "waiting")

    def __init__(self, identifier: int, kind: int, mapped: list[tuple[int, Entry]]) -> None:
        self.identifier, self.kind, self.synchronous = identifier, kind, kind in SYNCHRONOUS
        self.entries = [entry for _, entry in mapped]
        self.has_controlword = any(number == CONTROLWORD for number, _ in mapped)
        self.codes = struct.Struct("<" + "".join(entry.code for entry in self.entries))
        self.waiting: bytes | None = None
        self.last = b""

    def put(self, data: bytes) -> None:
        """Write what has come into the objects."""
        for entry, value in zip(self.entries, self.codes.unpack_from(data), strict=True):
            entry.value = value

    def take(self) -> bytes:
        """What the objects hold."""
        return self.codes.pack(*[entry.value for entry in self.entries])


class ProcessData:
    """The PDOs of a node that are valid. `sort_out` is called whenever one comes or goes."""

    def __init__(self, objects: dict[int, Entry], sort_out: Callable[[], None]) -> None:
        self._objects, self._sort_out = objects, sort_out
        self.received: list[Pdo] = []
        self.sent: list[Pdo] = []
        self.compile()

    def check(self, index: int, sub: int, value: int, preoperational: bool) -> None:
        """Whether an object of a PDO may be written now. Raises Abort."""
        mapping, number = index & 0x200, index & 0x1FF
        kind = (index & 0xFC00) + number  # communication parameters of the same PDO
        cob = self._objects[key(kind, 1)].value
        if not preoperational:
            raise Abort(ABORT_STATE)
        if not mapping:
            if sub == 1 and not cob & INVALID_COB and not value & INVALID_COB and value != cob:
                raise Abort(ABORT_STATE)
            return
        if not cob & INVALID_COB:
            raise Abort(ABORT_STATE)
        count = self._objects[key(index, 0)]
        if sub == 0:
            if value and count.value:
                raise Abort(ABORT_STATE)
            self._check_length(index, value)
        elif count.value:
            raise Abort(ABORT_STATE)
        else:
            entry = self._objects.get(value >> 8)
            if entry is None or not entry.mappable or entry.size * 8 != value & 0xFF or (index < 0x1800 and not entry.writable):  # fmt: skip
                raise Abort(ABORT_NOT_MAPPABLE)

    def _check_length(self, index: int, count: int) -> None:
        if count > 8:
            raise Abort(ABORT_PDO_LENGTH)
        mapped = [self._objects[key(index, sub)].value for sub in range(1, count + 1)]
        if not all(mapped) or sum(value & 0xFF for value in mapped) > 64:
            raise Abort(ABORT_PDO_LENGTH)

    def compile(self) -> None:
        """Make the valid PDOs anew."""
        self.received = self._valid(0x1400, 0x1600)
        self.sent = self._valid(0x1800, 0x1A00)
        self._sort_out()

    def _valid(self, parameters: int, mapping: int) -> list[Pdo]:
        found = []
        for number in range(PDOS):
            cob = self._objects[key(parameters + number, 1)].value
            count = self._objects[key(mapping + number, 0)].value
            if cob & INVALID_COB or not count:
                continue
            numbers = [self._objects[key(mapping + number, sub)].value >> 8 for sub in range(1, count + 1)]
            kind = self._objects[key(parameters + number, 2)].value
            found.append(Pdo(cob & 0x7FF, kind, [(n, self._objects[n]) for n in numbers]))
        return found
