"""The C++ header of the tick's records and named numbers, written from the dtypes and constants of the kernels."""

import enum
from collections.abc import Iterator
from types import ModuleType

import numpy as np

from hal.frames import VALID
from hal.troubles import Grade
from rtctl import device_clock, hlc, homing, judge, lifecycle, trajectory
from rtctl.commands import Reason, Verb
from rtctl.controller import Controller
from rtctl.electrode.path import MAX_CHANNELS
from rtctl.exchange import control
from rtctl.robots import interface, planar_3rpr

TYPES = {"f8": "double", "i8": "int64_t", "u8": "uint64_t", "i4": "int32_t", "u4": "uint32_t", "u1": "uint8_t"}
ENUMS: tuple[type[enum.IntEnum], ...] = (
    Verb,
    Reason,
    lifecycle.Operating,
    lifecycle.Task,
    lifecycle.Motion,
    lifecycle.Condition,
)
CONSTANTS: dict[str, int | float] = {
    "VALID": VALID,
    **{f"TROUBLE_{g.name}": int(g) for g in Grade},
    "MAX_CHANNELS": MAX_CHANNELS,
    "CLOCK_REFUSED": int(device_clock.REFUSED),
    "OVERSPEED": trajectory.OVERSPEED,
    "RETURN_MM": hlc.RETURN_MM,
    "STILL": homing.STILL,
    "LAST_VERB": judge.LAST_VERB,
    **{n: getattr(planar_3rpr, n) for n in ("NEWTON_STEP", "NEWTON_LIMIT", "STROKE_TOLERANCE_MM")},
    **{n: getattr(interface, n) for n in ("REACHABLE", "OUTSIDE_BOX", "STROKE_LIMIT", "SINGULAR")},
    **{n: getattr(lifecycle, n) for n in ("FAULT_MASK", "PAUSE_MASK", "STOP_MASK", "RETRACTION_MASK")},
    **{
        n: getattr(control, n)
        for n in ("ALIVE", "LOG_WRITING", "OPERATOR_PRESENT", "OPERATOR_EXPECTED", "GATEWAY_EXPECTED", "ARMING_ALLOWED")
    },
}
"""What the C++ calls by the name it has in Python."""
PREAMBLE = ("#pragma once", "#include <cstddef>", "#include <cstdint>", "#include <limits>")


def header(controller: Controller) -> str:
    """Text of layout.hpp: structs `Memory`, `Sensors`, `Actuators`, `Record` with all they hold, and constants."""
    structs = Structs()
    for array, name in (
        (controller.memory, "Memory"),
        (controller.sensors, "Sensors"),
        (controller.actuators, "Actuators"),
        (controller.record, "Record"),
    ):
        structs.add(name, array.dtype)
    sizes: dict[str, int | float] = {"DOF": controller.axes - 1, "AXES": controller.axes}
    parts = [
        *PREAMBLE,
        "constexpr double NOT_KNOWN = std::numeric_limits<double>::quiet_NaN();",
        *(_constant(name, value) for name, value in (sizes | CONSTANTS).items()),
        f"constexpr int64_t REACTION[] = {{{', '.join(str(int(r)) for r in lifecycle.REACTION)}}};",
        *(_enumeration(names) for names in ENUMS),
        *structs.texts,
    ]
    return "\n".join(parts) + "\n"


def robot_header(dtype: np.dtype, module: ModuleType) -> str:
    """Text of robot.hpp: struct `Robot` and the constants of Newton's method in the robot's `module`."""
    structs = Structs()
    structs.add("Robot", dtype)
    constants = (_constant(name, getattr(module, name)) for name in ("NEWTON_STEP", "NEWTON_LIMIT"))
    return "\n".join([*PREAMBLE, *constants, *structs.texts]) + "\n"


class Structs:
    """C++ structs of numpy dtypes, each dtype once, inner ones first."""

    def __init__(self) -> None:
        self.texts: list[str] = []
        self._names: dict[np.dtype, str] = {}

    def add(self, name: str, dtype: np.dtype) -> str:
        """Name of the struct that has the layout of `dtype`: `name`, or the one it was first met under."""
        if dtype not in self._names:
            members = list(self._members(dtype))
            self._names[dtype] = name
            lines = [f"    {kind} {member}{extent};" for member, kind, extent in members]
            offsets = {member: field[1] for member, field in (dtype.fields or {}).items()}
            proofs = [f'static_assert(offsetof({name}, {m}) == {offset}, "layout");' for m, offset in offsets.items()]
            size = f'static_assert(sizeof({name}) == {dtype.itemsize}, "layout");'
            self.texts.append("\n".join([f"struct {name} {{", *lines, "};", *proofs, size]))
        return self._names[dtype]

    def _members(self, dtype: np.dtype) -> Iterator[tuple[str, str, str]]:
        """(name, type, extents) of every field."""
        for member in dtype.names or ():
            field = dtype[member]
            kind = self.add(member.capitalize(), field.base) if field.base.names else TYPES[field.base.str[1:]]
            yield member, kind, "".join(f"[{n}]" for n in field.shape)


def _constant(name: str, value: int | float) -> str:
    return f"constexpr {'double' if isinstance(value, float) else 'int64_t'} {name} = {value!r};"


def _enumeration(names: type[enum.IntEnum]) -> str:
    members = " ".join(f"constexpr int64_t {m.name} = {m.value};" for m in names)
    return f"namespace {names.__name__} {{ {members} }}"
