"""The robots there are. Adding one is a file in this folder and a line in `KINDS`."""

from collections.abc import Callable, Mapping
from typing import Any

from hal.errors import OptionError
from rtctl.robots import planar_3rpr
from rtctl.robots.robot import Robot, RobotError

__all__ = ["KINDS", "Robot", "RobotError", "load"]

KINDS: dict[str, Callable[[Mapping[str, Any]], Robot]] = {
    "planar_3rpr": planar_3rpr.load,
}


def load(kind: str, options_table: Mapping[str, Any]) -> Robot:
    """The robot `kind` with the geometry and limits of `options_table` (the table ``robot.geometry``).

    Raises:
        OptionError: unknown kind, or an option the robot does not accept.
        RobotError: the geometry has no usable home.
    """
    if kind not in KINDS:
        raise OptionError("unknown robot", value=kind, bound=" | ".join(KINDS), remedy="set robot.kind")
    return KINDS[kind](options_table)
