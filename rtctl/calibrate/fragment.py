"""A calibration's result as a fragment of settings: TOML that `--set @FILE` puts on top of a settings file."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from rtctl.calibrate.errors import CalibrationFileError


def text(title: str, provenance: Mapping[str, Any], tables: Mapping[str, Mapping[str, Any]]) -> str:
    """The fragment: what it is and where it comes from as comments, then the tables.

    tables: dotted name -> option -> number, or nested list of numbers.
    """
    lines = [f"# {title}", "#", *(f"# {name}: {value}" for name, value in provenance.items())]
    for name, table in tables.items():
        lines += ["", f"[{name}]", *(f"{key} = {_toml(value)}" for key, value in table.items())]
    return "\n".join(lines) + "\n"


def write(path: Path, content: str) -> None:
    """Write a new file. Raises CalibrationFileError if it exists already or cannot be written."""
    try:
        with path.open("x") as file:
            file.write(content)
    except FileExistsError:
        remedy = "give another name with --to, or remove it"
        raise CalibrationFileError("the file exists, and calibrations are not overwritten", value=str(path), remedy=remedy) from None  # fmt: skip
    except OSError as error:
        raise CalibrationFileError("the file cannot be written", value=str(path), remedy=str(error.strerror)) from None


def _toml(value: Any) -> str:
    if isinstance(value, list | tuple):
        return f"[{', '.join(_toml(v) for v in value)}]"
    return repr(float(value))
