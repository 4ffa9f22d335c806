"""The robots there are. Adding one is a file in this folder and a line in `KINDS`."""

import hashlib
import json
from collections.abc import Callable, Mapping
from typing import Any

from hal.errors import OptionError
from hal.options import read, table_of
from rtctl.robots import cartesian_4, cochlerob, hexapod, planar_3rpr
from rtctl.robots.robot import Robot, RobotError

__all__ = ["GEOMETRIES", "KINDS", "Robot", "RobotError", "fingerprint", "load"]

KINDS: dict[str, Callable[[Mapping[str, Any]], Robot]] = {
    "planar_3rpr": planar_3rpr.load,
    "cartesian_4": cartesian_4.load,
    "hexapod": hexapod.load,
    "cochlerob": cochlerob.load,
}

GEOMETRIES: dict[str, type] = {
    "planar_3rpr": planar_3rpr.Planar3rprOptions,
    "cartesian_4": cartesian_4.Cartesian4Options,
    "hexapod": hexapod.HexapodOptions,
    "cochlerob": cochlerob.CochlerobOptions,
}
"""Options of every robot: its geometry and limits."""


def load(kind: str, options_table: Mapping[str, Any]) -> Robot:
    """The robot `kind` with the geometry and limits of `options_table` (the table ``robot.geometry``).

    Raises:
        OptionError: unknown kind, or an option the robot does not accept.
        RobotError: the geometry has no usable home.
    """
    if kind not in KINDS:
        raise OptionError("unknown robot", value=kind, bound=" | ".join(KINDS), remedy="set robot.kind")
    return KINDS[kind](options_table)


def fingerprint(kind: str, options_table: Mapping[str, Any]) -> str:
    """Sixteen hex digits of geometry and limits, defaults included: equal for robots that are modelled equally.

    Raises:
        OptionError: as :func:`load`.
    """
    load(kind, options_table)
    options = table_of(read(GEOMETRIES[kind], options_table, "robot.geometry"))
    return hashlib.sha256(json.dumps([kind, options], sort_keys=True).encode()).hexdigest()[:16]
