"""Signals and tables of them: one description gives the dtype of a record, its message text and its documentation."""

from dataclasses import dataclass

import numpy as np

ROS_TYPES = {"f8": "float64", "i8": "int64", "u8": "uint64", "i4": "int32", "u4": "uint32", "u1": "uint8"}
SIZES = {"f8": 8, "i8": 8, "u8": 8, "i4": 4, "u4": 4, "u1": 1}


@dataclass(frozen=True)
class Signal:
    """One named value of a record: its type, shape, unit, frame and meaning."""

    name: str
    type: str
    shape: tuple[int, ...]
    unit: str
    meaning: str
    frame: str = ""


@dataclass(frozen=True)
class Table:
    """An ordered set of signals and everything that follows from it."""

    name: str
    signals: tuple[Signal, ...]

    def __post_init__(self) -> None:
        sizes = [SIZES[s.type] for s in self.signals]
        if sizes != sorted(sizes, reverse=True) or self.signals[0].name != "time_ns":
            raise ValueError(f"{self.name}: time_ns first, then signals from large to small")

    @property
    def dtype(self) -> np.dtype:
        """Packed dtype; its size is a multiple of 8, so rows of a ring stay aligned."""
        fields: list[tuple] = [(s.name, s.type, s.shape) if s.shape else (s.name, s.type) for s in self.signals]
        size = sum(np.dtype(f[1:] if len(f) > 2 else f[1]).itemsize for f in fields)
        if size % 8:
            fields.append(("reserved", "u1", (8 - size % 8,)))
        return np.dtype(fields)

    @property
    def message(self) -> str:
        """The record as a flat ros2msg definition, with unit, frame and meaning as comments."""
        lines = []
        documented = {s.name: s for s in self.signals}
        dtype = self.dtype
        for name in dtype.names or ():
            base, shape = dtype[name].base, dtype[name].shape
            array = f"[{int(np.prod(shape))}]" if shape else ""
            comment = ""
            if name in documented:
                s = documented[name]
                comment = "  # " + "; ".join(t for t in (f"[{s.unit}]" if s.unit else "", s.frame, s.meaning) if t)
            lines.append(f"{ROS_TYPES[base.str[1:]]}{array} {name}{comment}")
        return "\n".join(lines) + "\n"


TIME = Signal("time_ns", "u8", (), "ns", "grid time of the tick; since the Unix epoch, or since the start in lockstep")
TICK = Signal("tick", "i8", (), "", "number of the tick on the loop's grid")
