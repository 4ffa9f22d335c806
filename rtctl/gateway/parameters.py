"""The parameter set in force, and how one becomes another while the controller runs."""

import contextlib
import dataclasses
import difflib
import json
from pathlib import Path
from typing import Any

import numpy as np

from hal.errors import OptionError
from hal.options import bound_text, describe, table_of
from rtctl.gateway.refusal import Refusal, from_error
from rtctl.parameters import pack
from rtctl.robots import Robot
from rtctl.settings import Settings, from_table, public_table

FIELDS: dict[str, dataclasses.Field[Any]] = {name: field for name, _, field in describe(Settings)}
LIVE = tuple(name for name, field in FIELDS.items() if field.metadata.get("live"))


class Parameters:
    """Settings of a run with the live changes made so far, which outlive the gateway in a file of the run."""

    def __init__(self, settings: Settings, robot: Robot, directory: Path) -> None:
        self._start, self._robot = settings, robot
        self._file = directory / "parameters.json"
        self.changes: dict[str, Any] = json.loads(self._file.read_text()) if self._file.exists() else {}
        self.settings = self._changed(self.changes)

    def values(self, names: list[str] | None = None) -> dict[str, Any]:
        """Values in force by dotted name; of all options without `names`.

        Raises:
            Refusal: there is no such option.
        """
        table = public_table(self.settings)
        return {name: _look_up(table, name) for name in names or FIELDS}

    def live_values(self, settings: Settings) -> dict[str, Any]:
        """Values of all live options of `settings`."""
        table = public_table(settings)
        return {name: _look_up(table, name) for name in LIVE}

    def reference(self) -> dict[str, dict[str, Any]]:
        """Every option: value, unit, bounds, meaning, and whether it may be changed now."""
        table = public_table(self.settings)
        return {
            name: {
                "value": _look_up(table, name),
                "unit": field.metadata.get("unit", ""),
                "bound": bound_text(field),
                "live": name in LIVE,
                "doc": field.metadata.get("doc", ""),
            }
            for name, field in FIELDS.items()
        }

    def propose(self, values: dict[str, Any]) -> Settings:
        """The settings with `values` (dotted name -> value) on top, checked as a whole.

        Raises:
            Refusal: an option that does not exist or is not live, or a set that is not valid.
        """
        for name in values:
            _require(name)
            if name not in LIVE:
                remedy = "change the settings file and start again"
                raise Refusal("not_live", f"{name} cannot be changed while the controller runs", remedy)
        try:
            return self._changed({**self.changes, **values})
        except OptionError as error:
            raise from_error("invalid_setting", error) from None

    def packed(self, settings: Settings, number: int) -> np.ndarray:
        """Parameter set `number` (1,) as the tick reads it."""
        return pack(settings, self._robot, number)

    def adopt(self, values: dict[str, Any]) -> None:
        """`values` are in force from now on, also for a gateway that replaces this one."""
        self.changes = {**self.changes, **values}
        self.settings = self._changed(self.changes)
        spare = self._file.with_suffix(".new")
        with contextlib.suppress(OSError):  # the set is in force whether or not a successor will know it
            spare.write_text(json.dumps(self.changes))
            spare.replace(self._file)

    def _changed(self, changes: dict[str, Any]) -> Settings:
        table = table_of(self._start)
        for name, value in changes.items():
            section, option = name.split(".")
            table[section][option] = value
        return from_table(table)


def _require(name: str) -> None:
    if name not in FIELDS:
        near = difflib.get_close_matches(name, FIELDS, n=1, cutoff=0.5)
        remedy = f"did you mean {near[0]}?" if near else "see `rtctl param list`"
        raise Refusal("unknown_parameter", f"there is no option {name}", remedy)


def _look_up(table: dict[str, Any], name: str) -> Any:
    _require(name)
    value: Any = table
    for part in name.split("."):
        value = value[part]
    return value
