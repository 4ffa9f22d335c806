"""Typed, bounded, unit-named options: one TOML table in, one frozen dataclass out.

A field is declared in one line with :func:`option`; :func:`read` turns a parsed TOML table into the
dataclass and refuses everything it does not know. Bounds are part of the declaration, so the same
line is the check, the default and the reference documentation (:func:`describe`).
"""

import dataclasses
import difflib
import math
import types
import typing
from collections.abc import Iterator, Mapping
from dataclasses import MISSING
from typing import Any, TypeVar

from hal.errors import OptionError

T = TypeVar("T")


def option(
    default: Any = MISSING,
    *,
    low: float | None = None,
    high: float | None = None,
    unit: str = "",
    doc: str,
    choices: tuple[str, ...] = (),
    shape: tuple[int, ...] = (),
    live: bool = False,
) -> Any:
    """Declare one option of an options dataclass.

    Args:
        default: value when the key is absent; without one the key is required.
        low, high: inclusive bounds of every number in the value.
        unit: physical unit, also the suffix of the field's name where it has one.
        doc: one sentence for the reference.
        choices: the words a string may be.
        shape: shape of a nested list of numbers, () for a scalar, -1 for any length.
        live: may be changed while the controller runs (``rtctl param set``).
    """
    metadata = {
        "low": low, "high": high, "unit": unit, "doc": doc, "choices": choices, "shape": shape, "live": live,
    }  # fmt: skip
    if isinstance(default, dict):
        return dataclasses.field(default_factory=default.copy, metadata=metadata)
    return dataclasses.field(default=default, metadata=metadata)


def read(cls: type[T], table: Mapping[str, Any], where: str = "") -> T:
    """Build `cls` from a parsed TOML `table`; `where` is the dotted path used in messages.

    Raises:
        OptionError: unknown key (with the nearest known one), missing key, wrong type, value out of bounds.
    """
    if not isinstance(table, Mapping):
        raise OptionError(f"{where or 'settings'} must be a table", value=table, remedy=f"write [{where}]")
    hints = typing.get_type_hints(cls)
    fields = {f.name: f for f in dataclasses.fields(cls)}  # type: ignore[arg-type]
    for key in table:
        if key not in fields:
            raise _unknown(key, where, fields)
    values = {}
    for name, field in fields.items():
        path = f"{where}.{name}" if where else name
        if name in table:
            values[name] = _value(hints[name], field, table[name], path)
        elif dataclasses.is_dataclass(hints[name]) and field.default is MISSING and field.default_factory is MISSING:
            values[name] = read(hints[name], {}, path)  # every option inside may have a default
        elif field.default is MISSING and field.default_factory is MISSING:
            raise OptionError(f"{path} is missing", remedy=f"set it: {field.metadata.get('doc', '')}".rstrip(": "))
    return cls(**values)


def table_of(options: Any) -> dict[str, Any]:
    """The inverse of :func:`read`: a plain table that reads back to an equal dataclass."""
    return {
        f.name: table_of(v) if dataclasses.is_dataclass(v) else _plain(v)
        for f in dataclasses.fields(options)
        if (v := getattr(options, f.name)) is not None
    }


def describe(cls: type, where: str = "") -> Iterator[tuple[str, Any, dataclasses.Field[Any]]]:
    """Every leaf option below `cls` as (dotted path, type, field), in order of declaration."""
    hints = typing.get_type_hints(cls)
    for field in dataclasses.fields(cls):
        path = f"{where}.{field.name}" if where else field.name
        if dataclasses.is_dataclass(hints[field.name]):
            yield from describe(hints[field.name], path)
        else:
            yield path, hints[field.name], field


def bound_text(field: dataclasses.Field[Any]) -> str:
    """The bounds of a field in words, empty if it has none."""
    meta = field.metadata
    if meta.get("choices"):
        return " | ".join(meta["choices"])
    low, high = meta.get("low"), meta.get("high")
    if low is None and high is None:
        return ""
    unit = f" {meta['unit']}" if meta.get("unit") else ""
    if low is None:
        return f"at most {high:g}{unit}"
    if high is None:
        return f"at least {low:g}{unit}"
    return f"{low:g} .. {high:g}{unit}"


def _unknown(key: str, where: str, fields: Mapping[str, Any]) -> OptionError:
    near = difflib.get_close_matches(key, fields, n=1, cutoff=0.5)
    path = f"{where}.{key}" if where else key
    remedy = f"did you mean '{near[0]}'?" if near else f"known here: {', '.join(fields)}"
    return OptionError(f"unknown key {path}", remedy=remedy)


def _value(hint: Any, field: dataclasses.Field[Any], value: Any, path: str) -> Any:
    if dataclasses.is_dataclass(hint):
        return read(hint, value, path)  # type: ignore[arg-type]
    if typing.get_origin(hint) in (types.UnionType, typing.Union):
        (hint,) = (h for h in typing.get_args(hint) if h is not type(None))
        return _value(hint, field, value, path)
    if typing.get_origin(hint) is tuple:
        return _array(field, value, path, field.metadata["shape"])
    if hint is dict or typing.get_origin(hint) is dict:
        if not isinstance(value, Mapping):
            raise OptionError(f"{path} must be a table", value=value, remedy=f"write [{path}]")
        return dict(value)
    return _scalar(hint, field, value, path)


def _array(field: dataclasses.Field[Any], value: Any, path: str, shape: tuple[int, ...]) -> Any:
    if not shape:
        return _scalar(float, field, value, path)
    if not isinstance(value, list | tuple) or (shape[0] >= 0 and len(value) != shape[0]):
        wanted = "a list" if shape[0] < 0 else f"a list of {shape[0]}"
        raise OptionError(f"{path} must be {wanted}", value=value, remedy=field.metadata["doc"])
    return tuple(_array(field, v, f"{path}[{i}]", shape[1:]) for i, v in enumerate(value))


def _scalar(hint: Any, field: dataclasses.Field[Any], value: Any, path: str) -> Any:
    if hint is float and isinstance(value, int) and not isinstance(value, bool):
        value = float(value)
    if not isinstance(value, hint) or (isinstance(value, bool) and hint is not bool):
        raise OptionError(f"{path} must be a {hint.__name__}", value=value, bound=bound_text(field))
    if isinstance(value, float) and not math.isfinite(value):
        raise OptionError(f"{path} must be a finite number", value=value, bound=bound_text(field))
    low, high, choices = (field.metadata.get(k) for k in ("low", "high", "choices"))
    if (low is not None and value < low) or (high is not None and value > high) or (choices and value not in choices):
        raise OptionError(f"{path} is out of bounds", value=value, bound=bound_text(field))
    return value


def _plain(value: Any) -> Any:
    return [_plain(v) for v in value] if isinstance(value, tuple) else value
