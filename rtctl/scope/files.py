"""Captures in files: MCAP for viewers and for :func:`load`, CSV, and numpy's own format.

Names of signals become those of a message: ``wrench_in_base[2]`` is ``wrench_in_base_2`` in a file.
"""

import csv
import re
from collections.abc import Sequence
from pathlib import Path

import msgspec
import numpy as np

from hal.signals import SIZES, Signal, Table
from rtctl.log.format import LogError
from rtctl.log.reader import Log
from rtctl.log.writer import LogWriter
from rtctl.scope.capture import Capture
from rtctl.scope.probe import ALWAYS, row_dtype
from rtctl.scope.setup import ScopeError

TOPIC, CAPTURES = "/scope", "/captures"
HEADER = "scope"
NUMBER = Signal("capture", "i4", (), "", "which capture of the scope, from 0")
SUFFIXES = (".mcap", ".csv", ".npy")


def check(path: str | Path) -> Path:
    """The path of a file that can be written. Raises ScopeError for an unknown ending or a file that exists."""
    file = Path(path)
    if file.suffix not in SUFFIXES:
        raise ScopeError("unknown kind of file for captures", value=file.name, bound=" | ".join(SUFFIXES))
    if file.exists():
        raise ScopeError("there is a file of that name", value=str(file), remedy="choose another; captures are not overwritten")  # fmt: skip
    return file


def save(captures: Sequence[Capture], path: str | Path) -> None:
    """Write captures of one scope, at least one, to a new file; its ending says how.

    Raises:
        ScopeError: an unknown ending, or the file exists.
        LogError: it cannot be written.
    """
    file = check(path)
    table, rows = flat(captures)
    if file.suffix == ".mcap":
        _save_mcap(captures, file, table, rows)
        return
    try:
        if file.suffix == ".npy":
            with file.open("xb") as binary:
                np.save(binary, rows)
        else:
            _save_csv(file, rows, np.concatenate([c.time_s for c in captures]).round(9))
    except OSError as error:
        raise LogError("cannot write the captures", value=f"{file}: {error.strerror}") from error


def load(path: str | Path) -> list[Capture]:
    """The captures of an MCAP file of :func:`save`.

    Raises:
        LogError: not such a file.
    """
    log = Log.open(path)
    if HEADER not in log.header or TOPIC not in log.rows:
        raise LogError("no captures of a scope are in this file", value=str(path))
    signals = msgspec.json.decode(log.header[HEADER], type=tuple[Signal, ...])
    rows, dtype = log.rows[TOPIC], row_dtype(signals)
    captures = []
    for message in log.messages.get(CAPTURES, ()):
        mine = rows[rows["capture"] == message.payload["number"]]
        own = np.zeros(len(mine), dtype)
        for name in dtype.names or ():
            own[name] = mine[field_of(name)]
        captures.append(Capture(rows=own, signals=signals, **message.payload))
    return captures


def flat(captures: Sequence[Capture]) -> tuple[Table, np.ndarray]:
    """All samples of the captures in one array (n,), and the table that describes it, large signals first."""
    signals = (*ALWAYS, NUMBER, *captures[0].signals)
    fields = [Signal(field_of(s.name), s.type, s.shape, s.unit, s.meaning, s.frame) for s in signals]
    table = Table("Scope", tuple(sorted(fields, key=lambda s: -SIZES[s.type])))
    rows = np.zeros(sum(map(len, captures)), table.dtype)
    for s in (*ALWAYS, *captures[0].signals):
        rows[field_of(s.name)] = np.concatenate([c[s.name] for c in captures])
    rows[NUMBER.name] = np.repeat([c.number for c in captures], [len(c) for c in captures])
    return table, rows


def field_of(name: str) -> str:
    """The name of a signal in a file."""
    return re.sub(r"[.\[]", "_", name).rstrip("]")


def _save_mcap(captures: Sequence[Capture], file: Path, table: Table, rows: np.ndarray) -> None:
    description = msgspec.json.encode(captures[0].signals).decode()
    with LogWriter(file, {TOPIC: table}, {HEADER: description}) as writer:
        for capture in captures:
            writer.write_json(CAPTURES, capture.trigger_time_ns, capture.facts())
            writer.write_rows(TOPIC, rows[rows[NUMBER.name] == capture.number])


def _save_csv(file: Path, rows: np.ndarray, time_s: np.ndarray) -> None:
    names = [n for n in rows.dtype.names or () if n not in ("reserved", "time_ns")]
    names.sort(key=lambda n: [NUMBER.name, "tick", "missed", "lost"].index(n) if n in (NUMBER.name, "tick", "missed", "lost") else 9)  # fmt: skip
    columns, heads = [time_s], ["time_s"]
    for name in names:
        parts = rows[name].reshape(len(rows), -1).T
        columns += list(parts)
        heads += [name] if rows[name].ndim == 1 else [f"{name}_{k}" for k in range(len(parts))]
    with file.open("x", newline="", encoding="utf-8") as text:
        writer = csv.writer(text)
        writer.writerow(heads)
        writer.writerows(zip(*(column.tolist() for column in columns), strict=True))
