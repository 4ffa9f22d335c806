"""Object dictionary of an emulated EPOS drive, as its SDO server shows it (07 section 2.3)."""

import struct
from dataclasses import dataclass

ABORT_NO_OBJECT, ABORT_NO_SUBINDEX = 0x06020000, 0x06090011
ABORT_READ_ONLY, ABORT_LENGTH, ABORT_RANGE = 0x06010002, 0x06070010, 0x06090030
ABORT_NOT_MAPPABLE, ABORT_PDO_LENGTH, ABORT_STATE = 0x06040041, 0x06040042, 0x08000022
INVALID_COB = 1 << 31
ASYNCHRONOUS = 0xFF
PDOS = 4
MODES = {"epos4": (1, 3, 6, 8, 9, 10), "epos2": (1, 3, 6, -1, -2, -3, -4, -5, -6)}


class Abort(Exception):
    """The server refuses an SDO transfer, with this code."""

    def __init__(self, code: int) -> None:
        self.code = code
        super().__init__(f"{code:08X}")


@dataclass(slots=True)
class Entry:
    """One object: its value and how it looks in bytes (`code` of struct)."""

    code: str
    value: int
    writable: bool = True
    mappable: bool = False

    @property
    def size(self) -> int:
        """In bytes."""
        return struct.calcsize("<" + self.code)

    def pack(self) -> bytes:
        """As it travels."""
        return struct.pack("<" + self.code, self.value)


def key(index: int, sub: int = 0) -> int:
    """Of an object in the dictionary."""
    return index << 8 | sub


def make(node: int, generation: str) -> dict[int, Entry]:
    """A drive as it comes out of its reset: nothing of what was written before survives."""
    objects = {key(index, sub): Entry(code, value, *rest) for index, sub, code, value, *rest in _COMMON}
    rows = _EPOS4 if generation == "epos4" else _EPOS2
    objects.update({key(index, sub): Entry(code, value, *rest) for index, sub, code, value, *rest in rows})
    objects[key(0x1014)] = Entry("I", 0x80 + node)
    objects[key(0x1018, 4)] = Entry("I", 0x1000 + node, False)
    bits = sum(1 << mode - 1 for mode in MODES[generation] if mode > 0)
    objects[key(0x6502)] = Entry("I", bits, False)
    for number in range(PDOS):
        for parameters, mapping, base in ((0x1400, 0x1600, 0x200), (0x1800, 0x1A00, 0x180)):
            cob = base + (number << 8) + node
            objects[key(parameters + number, 0)] = Entry("B", 2, False)
            objects[key(parameters + number, 1)] = Entry("I", cob if number == 0 else cob | INVALID_COB)
            objects[key(parameters + number, 2)] = Entry("B", ASYNCHRONOUS)
            objects[key(mapping + number, 0)] = Entry("B", int(number == 0))
            for sub in range(1, 9):
                objects[key(mapping + number, sub)] = Entry("I", 0)
    objects[key(0x1600, 1)].value = 0x60400010
    objects[key(0x1A00, 1)].value = 0x60410010
    return objects


_COMMON: tuple[tuple, ...] = (
    (0x1000, 0, "I", 0x00020192, False),
    (0x1001, 0, "B", 0, False, True),
    (0x1003, 0, "B", 0),
    (0x1003, 1, "I", 0, False),
    (0x1005, 0, "I", 0x80),
    (0x1016, 0, "B", 1, False),
    (0x1016, 1, "I", 0),
    (0x1017, 0, "H", 0),
    (0x1018, 0, "B", 4, False),
    (0x1018, 1, "I", 0xFB, False),
    (0x1018, 2, "I", 0x62100000, False),
    (0x1018, 3, "I", 0x01700000, False),
    (0x6007, 0, "h", 1),
    (0x603F, 0, "H", 0, False, True),
    (0x6040, 0, "H", 0, True, True),
    (0x6041, 0, "H", 0, False, True),
    (0x605A, 0, "h", 6),
    (0x605E, 0, "h", 0),
    (0x6060, 0, "b", 1, True, True),
    (0x6061, 0, "b", 1, False, True),
    (0x6062, 0, "i", 0, False, True),
    (0x6064, 0, "i", 0, False, True),
    (0x6065, 0, "I", 2000),
    (0x606C, 0, "i", 0, False, True),
    (0x607A, 0, "i", 0, True, True),
    (0x607D, 0, "B", 2, False),
    (0x607D, 1, "i", -(2**31)),
    (0x607D, 2, "i", 2**31 - 1),
    (0x6081, 0, "I", 1000),
    (0x6083, 0, "I", 10000),
    (0x6084, 0, "I", 10000),
    (0x6085, 0, "I", 10000),
)
"""index, sub-index, type, value after reset, writable, mappable."""

_EPOS4: tuple[tuple, ...] = (
    (0x3001, 0, "B", 5, False),
    (0x3001, 1, "I", 1000),
    (0x3001, 2, "I", 2000),
    (0x6066, 0, "H", 0),
    (0x6071, 0, "h", 0, True, True),
    (0x6077, 0, "h", 0, False, True),
    (0x6080, 0, "I", 50000),
    (0x60B2, 0, "h", 0, True, True),
    (0x60C2, 0, "B", 2, False),
    (0x60C2, 1, "B", 1),
    (0x60C2, 2, "b", -3),
    (0x60F4, 0, "i", 0, False, True),
    (0x60FF, 0, "i", 0, True, True),
)

_EPOS2: tuple[tuple, ...] = (
    (0x2030, 0, "h", 0, True, True),
    (0x2062, 0, "i", 0, True, True),
    (0x206B, 0, "i", 0, True, True),
    (0x20F4, 0, "h", 0, False, True),
    (0x6078, 0, "h", 0, False, True),
    (0x607F, 0, "I", 25000),
    (0x6410, 0, "B", 5, False),
    (0x6410, 1, "H", 1000),
    (0x6410, 2, "H", 2000),
)
