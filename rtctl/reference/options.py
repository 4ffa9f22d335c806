"""Options of settings, robots and backends as tables."""

import dataclasses
import typing
from collections.abc import Iterator
from typing import Any

from hal.options import bound_text
from rtctl.reference.markdown import table

LARGEST_SHOWN = 9
"""Defaults of more numbers than this are told by their size."""


def sections(cls: type, where: str, of: str = "") -> Iterator[str]:
    """Heading, explanation and table of every dataclass of options below `cls`, a table of TOML each.

    where: dotted name of the table. of: the robot or backend it belongs to, if it is not everybody's.
    """
    hints = typing.get_type_hints(cls)
    leaves = [f for f in dataclasses.fields(cls) if not dataclasses.is_dataclass(hints[f.name])]
    if leaves:
        yield f"### `[{where}]` of `{of}`" if of else f"## `[{where}]`"
        yield (cls.__doc__ or "").split("\n")[0]
        yield table(("key", "default", "unit", "bounds", "live", "meaning"), [_row(f) for f in leaves])
    for f in dataclasses.fields(cls):
        if dataclasses.is_dataclass(hints[f.name]):
            yield from sections(hints[f.name], f"{where}.{f.name}" if where else f.name, of)


def _row(f: dataclasses.Field[Any]) -> tuple[str, ...]:
    unit, live, doc = (f.metadata.get(k) for k in ("unit", "live", "doc"))
    return f"`{f.name}`", _default(f), unit or "", bound_text(f), "yes" if live else "", doc or ""


def _default(field: dataclasses.Field[Any]) -> str:
    """The default as TOML writes it."""
    if field.default_factory is not dataclasses.MISSING:
        return "empty"
    if field.default is dataclasses.MISSING:
        return "required"
    if field.default is None:
        return "absent"
    shape = field.metadata.get("shape", ())
    if len(shape) > 1 and shape[0] * shape[1] > LARGEST_SHOWN:
        return f"{shape[0]} x {shape[1]} numbers"
    return f"`{_toml(field.default)}`"


def _toml(value: Any) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, tuple):
        return f"[{', '.join(_toml(v) for v in value)}]"
    if isinstance(value, float):
        return f"{value:.6g}"
    return f'"{value}"' if isinstance(value, str) else str(value)
