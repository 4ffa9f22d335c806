"""Measurements as CSV: a header of known columns in any order, finite numbers, # for comments, errors with the line."""

import csv
import math
from pathlib import Path

import numpy as np

from rtctl.calibrate.errors import CalibrationFileError


def read(path: Path, columns: list[str]) -> tuple[np.ndarray, list[int]]:
    """The numbers (n, len(columns)) in a file, in the order of `columns`, and the line each row is from.

    Raises:
        CalibrationFileError: it cannot be read, columns are missing or unknown, or a line is not what it should be.
    """
    try:
        lines = path.read_text().splitlines()
    except (OSError, ValueError) as error:
        raise CalibrationFileError("the file cannot be read", value=str(path), remedy=str(error)) from None
    numbered = [(k, line) for k, line in enumerate(lines, 1) if line.strip() and not line.lstrip().startswith("#")]
    if not numbered:
        raise CalibrationFileError("the file is empty", value=str(path), remedy=f"its columns are {','.join(columns)}")
    header = [name.strip() for name in _cells(numbered[0][1])]
    if sorted(header) != sorted(columns):
        wrong = sorted(set(header) ^ set(columns)) or sorted({name for name in header if header.count(name) > 1})
        raise CalibrationFileError(f"{path}: wrong columns", value=wrong, bound=",".join(columns))
    rows = [_row(path, number, line, header) for number, line in numbered[1:]]
    table = np.array(rows, dtype=float).reshape(-1, len(header))
    return table[:, [header.index(name) for name in columns]], [number for number, _ in numbered[1:]]


def _cells(line: str) -> list[str]:
    return next(csv.reader([line]))


def _row(path: Path, number: int, line: str, header: list[str]) -> list[float]:
    cells = _cells(line)
    if len(cells) != len(header):
        what = f"{path}, line {number} has another number of columns than the header"
        raise CalibrationFileError(what, value=len(cells), bound=f"{len(header)}")
    values = []
    for name, cell in zip(header, cells, strict=True):
        try:
            value = float(cell)
        except ValueError:
            value = math.nan
        if not math.isfinite(value):
            raise CalibrationFileError(f"{path}, line {number}: {name} is not a finite number", value=cell)
        values.append(value)
    return values
