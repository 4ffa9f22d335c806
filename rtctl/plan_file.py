"""An insertion plan as a file: JSON that says what it is for, what it holds, and against what it was checked.

:func:`describe` and :func:`plan_in` turn a plan into such a document and back; :func:`save` and :func:`load` do so with
files. What is in a document is told by the dataclasses below, whose options are the check and the reference.
"""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from importlib import metadata
from pathlib import Path
from typing import Any

import numpy as np

from hal.options import option, read, table_of
from rtctl import robots
from rtctl.electrode.array_shape import STYLET_MAX_MM
from rtctl.electrode.insertion_cost import STEP_MM
from rtctl.electrode.patient import LARGEST_A_MM, SIDES, SMALLEST_A_MM, Cochlea
from rtctl.electrode.planning import Plan, cost_of, depths_mm
from rtctl.planner import PlanError
from rtctl.settings import Settings, config_hash

FORMAT, VERSION = "rtctl insertion plan", 1
COST_TOLERANCE = 1e-6
"""Relative: far above what another machine's library makes of the same poses, far below any other plan."""
ANEW = "make the plan anew with `rtctl plan make`"


class PlanFileError(PlanError):
    """A file does not hold an insertion plan, or not one that can be trusted."""

    exit_code = 2


@dataclass(frozen=True)
class RobotOfPlan:
    """The robot it was checked for."""

    kind: str = option(doc="robot.kind of the settings")
    geometry: str = option(doc="fingerprint of robot.geometry, defaults included: 16 hex digits")


@dataclass(frozen=True)
class ArrayOfPlan:
    """The array it is for."""

    modal_matrix: tuple[tuple[float, ...], ...] = option(
        shape=(4, 4), low=-10, high=10, unit="rad / mm^k", doc="A of theta(s, q) = psi(s)^T A eta(q)"
    )


@dataclass(frozen=True)
class CochleaOfPlan:
    """The patient it is for."""

    spiral_a_mm: float = option(low=SMALLEST_A_MM, high=LARGEST_A_MM, unit="mm", doc="A of the spiral")
    side: str = option(choices=SIDES, doc="ear")


@dataclass(frozen=True)
class Depths:
    """One entry a depth."""

    depth_mm: tuple[float, ...] = option(
        shape=(-1,), low=0.0, high=15.0, unit="mm", doc="every 0.5 mm from 0 on, as far as the cochlea allows"
    )
    pose_in_cochlea_mm_rad: tuple[tuple[float, ...], ...] = option(
        shape=(-1, 3), low=-100, high=100, unit="mm, mm, rad", doc="gripper pose b_x, b_y, phi in {C}"
    )
    stylet_mm: tuple[float, ...] = option(
        shape=(-1,), low=0.0, high=STYLET_MAX_MM, unit="mm", doc="stylet withdrawal, never decreasing"
    )
    cost_mm2: tuple[float, ...] = option(
        shape=(-1,), low=0.0, high=1e6, unit="mm^2", doc="f = (T^T T + U^T U) / 2 of (II.20); tells an edited file"
    )


@dataclass(frozen=True)
class Checked:
    """The settings it was checked against; for people, since every use checks anew."""

    config_hash: str = option(doc="of all settings")
    entry_pose_mm_rad: tuple[float, ...] = option(
        shape=(-1,), low=-1000, high=1000, unit="mm, rad", doc="entry it was placed at, in {B}"
    )
    insertion_speed_mm_per_s: float = option(low=0.0, high=100.0, unit="mm/s", doc="workflow.speed_mm_per_s")
    gripper_speed_mm_per_s: float = option(low=0.0, high=100.0, unit="mm/s", doc="trajectory.speed_mm_per_s")
    gripper_speed_rad_per_s: float = option(low=0.0, high=100.0, unit="rad/s", doc="trajectory.speed_rad_per_s")
    stylet_speed_mm_per_s: float = option(low=0.0, high=100.0, unit="mm/s", doc="stylet.speed_mm_per_s")
    stylet_stroke_mm: float = option(low=0.0, high=100.0, unit="mm", doc="stylet.stroke_mm")
    recess_angle_rad: float = option(low=0.0, high=1.6, unit="rad", doc="cochlea.recess_angle_rad")
    recess_clearance_mm: float = option(low=0.0, high=100.0, unit="mm", doc="cochlea.recess_clearance_mm")


@dataclass(frozen=True)
class PlanFile:
    """The document as a whole."""

    robot: RobotOfPlan
    electrode: ArrayOfPlan
    cochlea: CochleaOfPlan
    checked: Checked
    depths: Depths
    format: str = option(choices=(FORMAT,), doc="what this is")
    version: int = option(low=VERSION, high=VERSION, doc="of the format")
    made: str = option(doc="when, ISO 8601, UTC")
    program: str = option(doc="what made it")


def describe(settings: Settings, plan: Plan, pose_entry: np.ndarray, now: datetime | None = None) -> PlanFile:
    """The document of a plan that :func:`rtctl.planner.make_plan` has accepted for `settings` at `pose_entry` (dof,)."""
    s = settings
    return PlanFile(
        format=FORMAT,
        version=VERSION,
        made=(now or datetime.now(UTC)).isoformat(timespec="seconds"),
        program=f"rtctl {metadata.version('rtctl')}",
        robot=RobotOfPlan(s.robot.kind, robots.fingerprint(s.robot.kind, s.robot.geometry)),
        electrode=ArrayOfPlan(_rows(plan.modal_matrix)),
        cochlea=CochleaOfPlan(plan.cochlea.spiral_a_mm, plan.cochlea.side),
        depths=Depths(
            _numbers(plan.depth_mm), _rows(plan.pose_in_cochlea), _numbers(plan.stylet_mm), _numbers(plan.cost)
        ),
        checked=Checked(
            config_hash(s),
            _numbers(pose_entry),
            s.workflow.speed_mm_per_s,
            s.trajectory.speed_mm_per_s,
            s.trajectory.speed_rad_per_s,
            s.stylet.speed_mm_per_s,
            s.stylet.stroke_mm,
            s.cochlea.recess_angle_rad,
            s.cochlea.recess_clearance_mm,
        ),
    )


def plan_in(file: PlanFile) -> Plan:
    """The plan of a document, wherever it came from.

    Raises:
        PlanFileError: columns of different length, depths off the grid or beyond the cochlea, a stylet that goes back in,
            or costs that are not those of the poses: it was edited, or damaged.
    """
    d = file.depths
    plan = Plan(
        np.array(file.electrode.modal_matrix),
        Cochlea(file.cochlea.spiral_a_mm, file.cochlea.side),
        np.array(d.depth_mm),
        np.array(d.pose_in_cochlea_mm_rad).reshape(-1, 3),
        np.array(d.stylet_mm),
        np.array(d.cost_mm2),
    )
    n, most = len(plan.depth_mm), len(depths_mm(plan.cochlea))
    for name in ("pose_in_cochlea_mm_rad", "stylet_mm", "cost_mm2"):
        if len(getattr(d, name)) != n:
            raise PlanFileError(
                f"depths.{name} has another length than depth_mm", value=len(getattr(d, name)), bound=f"{n}"
            )
    if not 4 <= n <= most:
        raise PlanFileError(
            "the plan has a wrong number of depths", value=n, bound=f"4 .. {most} in this cochlea", remedy=ANEW
        )
    off = np.abs(plan.depth_mm - STEP_MM * np.arange(n))
    if off.max() > 1e-9:
        k = int(np.argmax(off))
        raise PlanFileError(f"depth {k} is off the grid", value=d.depth_mm[k], bound=f"{STEP_MM * k:g} mm", remedy=ANEW)
    back = int(np.argmin(np.diff(plan.stylet_mm)))
    if plan.stylet_mm[back + 1] < plan.stylet_mm[back]:
        what = f"the plan puts the stylet back in at depth {plan.depth_mm[back + 1]:g} mm"
        raise PlanFileError(what, value=d.stylet_mm[back + 1], bound=f"at least {d.stylet_mm[back]!r} mm", remedy=ANEW)
    cost = cost_of(plan)
    wrong = np.abs(cost - plan.cost) > COST_TOLERANCE * (1.0 + cost)
    if wrong.any():
        k = int(np.argmax(wrong))
        what = f"the cost at depth {plan.depth_mm[k]:g} mm is not that of the pose there: the file was changed"
        raise PlanFileError(what, value=d.cost_mm2[k], bound=f"{cost[k]:.9g} mm^2", remedy=ANEW)
    return plan


def known_plan(settings: Settings, file: PlanFile) -> Plan:
    """The plan of a document, for use with `settings`; :func:`rtctl.planner.make_plan` checks the rest.

    Raises:
        PlanError: as :func:`plan_in`, or it is for another robot.
    """
    for name, value, bound in (
        ("kind", file.robot.kind, settings.robot.kind),
        ("geometry", file.robot.geometry, robots.fingerprint(settings.robot.kind, settings.robot.geometry)),
    ):
        if value != bound:
            raise PlanError("the plan is for another robot", value=value, bound=f"robot.{name} {bound}", remedy=ANEW)
    return plan_in(file)


def document(file: PlanFile) -> dict[str, Any]:
    """As plain data, which :func:`from_document` reads back to an equal file."""
    return dict(sorted(table_of(file).items(), key=lambda member: isinstance(member[1], dict)))  # the small first


def from_document(content: Any) -> PlanFile:
    """The file of plain data.

    Raises:
        PlanFileError: it is no insertion plan, or of a version this program does not know.
        OptionError: a field is missing, unknown, of the wrong type, not finite or out of bounds.
    """
    if not isinstance(content, Mapping) or content.get("format") != FORMAT:
        value = content.get("format") if isinstance(content, Mapping) else type(content).__name__
        raise PlanFileError("this is not an insertion plan", value=value, bound=f"format {FORMAT!r}", remedy=ANEW)
    if content.get("version") != VERSION:
        what, remedy = "the plan has a format version this program does not know", ANEW
        raise PlanFileError(what, value=content.get("version"), bound=f"{VERSION}", remedy=remedy)
    return read(PlanFile, content, "plan")


def save(file: PlanFile, path: Path) -> None:
    """Write a document to a file, its tables a line a row.

    Raises:
        PlanFileError: the file cannot be written.
    """
    try:
        path.write_text(_text(document(file)) + "\n", encoding="utf-8")
    except OSError as error:
        raise PlanFileError("the plan cannot be written", value=str(path), remedy=str(error.strerror)) from None


def load(path: Path) -> PlanFile:
    """The document in a file.

    Raises:
        PlanFileError: the file cannot be read, is not JSON, or not an insertion plan.
        OptionError: as :func:`from_document`.
    """
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise PlanFileError("the plan cannot be read", value=str(path), remedy=str(error.strerror)) from None
    except (ValueError, RecursionError) as error:
        raise PlanFileError(f"{path} is not JSON", value=str(error), remedy=ANEW) from None
    return from_document(content)


def _text(value: Any, indent: str = "") -> str:
    """JSON with a line a member and a line a row."""
    inner = indent + "  "
    if isinstance(value, dict):
        members = [f"{inner}{json.dumps(name)}: {_text(member, inner)}" for name, member in value.items()]
        return "{\n" + ",\n".join(members) + f"\n{indent}}}"
    if isinstance(value, list) and value and isinstance(value[0], list):
        return "[\n" + ",\n".join(f"{inner}{json.dumps(row)}" for row in value) + f"\n{indent}]"
    return json.dumps(value, ensure_ascii=False)


def _numbers(values: np.ndarray) -> tuple[float, ...]:
    return tuple(float(v) for v in values)


def _rows(values: np.ndarray) -> tuple[tuple[float, ...], ...]:
    return tuple(_numbers(row) for row in values)
