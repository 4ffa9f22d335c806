"""``rtctl plan``: plans of the controller, and plans as files that can be made, looked at, checked and loaded."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from rtctl.cli.connection import connect
from rtctl.cli.console import grid, output, say
from rtctl.cli.options import (
    CONFIG,
    DEFAULT_CONFIG,
    DEFAULT_ENDPOINT,
    DEFAULT_ROBOT,
    ENDPOINT,
    JSON,
    OPERATE,
    ROBOT,
    SET,
)

if TYPE_CHECKING:
    import numpy as np
    from rich.table import Table

    from rtctl.electrode.planning import Plan
    from rtctl.plan_file import PlanFile
    from rtctl.settings import Settings

FILE = Annotated[Path, typer.Argument(help="File with a plan.", dir_okay=False)]
ENTRY = Annotated[
    tuple[float, float, float] | None,
    typer.Option(
        help="Registered entry: gripper pose in the base frame [mm, mm, rad]; workflow.entry_pose_mm_rad by default.",
        metavar="X Y PHI",
        show_default=False,
    ),
]
SETTINGS_FILE = Annotated[str, typer.Option("--config", help="Settings file, or one that ships.")]


def add_to(app: typer.Typer) -> None:
    """Add the group."""
    group = typer.Typer(invoke_without_command=True)
    group.callback()(plan)
    for command in (make, show, plot, check, load):
        group.command()(command)
    app.add_typer(group, name="plan", rich_help_panel=OPERATE)


def plan(context: typer.Context, robot: ROBOT = DEFAULT_ROBOT, endpoint: ENDPOINT = DEFAULT_ENDPOINT) -> None:
    """Plan the insertion from the registered entry and load the plan; or do something with a plan in a file.

    Example: `rtctl plan`
    """
    if context.invoked_subcommand is not None:
        for name in ("robot", "endpoint"):
            source = context.get_parameter_source(name)
            if source is not None and source.name == "COMMANDLINE":
                raise typer.BadParameter(f"--{name} belongs behind the word {context.invoked_subcommand}")
        return
    with connect(robot, endpoint) as client:
        reply = client.plan()
    say(f"plan {reply.result.get('number')} is in force from tick {reply.tick}")


def make(
    config: CONFIG = DEFAULT_CONFIG,
    to: Annotated[Path, typer.Option(help="File to write; an older one is replaced.", dir_okay=False)] = Path(
        "plan.json"
    ),
    entry: ENTRY = None,
    overrides: SET = None,
) -> None:
    """Compute the plan for a settings file and a registered entry, check it, and write it to a file.

    Example: `rtctl plan make planar-sim --to plan.json`
    """
    from rtctl import plan_file, planner
    from rtctl.settings import load as load_settings

    settings = load_settings(config, overrides or ())
    computed = planner.plan_of(settings)
    pose_entry = _accepted(settings, computed, entry)
    file = plan_file.describe(settings, computed, pose_entry)
    plan_file.save(file, to)
    say(f"{to}: {_words(computed)}")


def show(file: FILE, json: JSON = False) -> None:
    """Show what a plan is for, and its figures depth by depth.

    Example: `rtctl plan show plan.json`
    """
    import json as encoder

    from rtctl import plan_file

    content = plan_file.load(file)
    stored = plan_file.plan_in(content)
    if json:
        say(encoder.dumps(plan_file.document(content), indent=1, ensure_ascii=False))
        return
    output().print(grid(_facts(content, stored)))
    output().print(_table(content, stored))


def plot(
    file: FILE,
    to: Annotated[Path, typer.Option(help="Picture to write, .svg or .png.", dir_okay=False)] = Path("plan.svg"),
) -> None:
    """Draw the array at six depths of the cochlea.

    Example: `rtctl plan plot plan.json --to plan.svg`
    """
    from rtctl import plan_file
    from rtctl.report import plan_view, style

    content = plan_file.load(file)
    style.save(plan_view.draw(plan_file.plan_in(content), _entry_of(content), content.checked.recess_angle_rad), to)
    say(str(to))


def check(file: FILE, config: SETTINGS_FILE = DEFAULT_CONFIG, entry: ENTRY = None, overrides: SET = None) -> None:
    """Check a plan against a settings file: same robot, array and cochlea; within workspace, joints, recess and speeds.

    Example: `rtctl plan check plan.json --config planar-sim`
    """
    from rtctl import plan_file
    from rtctl.settings import load as load_settings

    settings = load_settings(config, overrides or ())
    known = plan_file.known_plan(settings, plan_file.load(file))
    _accepted(settings, known, entry)
    say(f"{file} is good for {config}: {_words(known)}")


def load(file: FILE, robot: ROBOT = DEFAULT_ROBOT, endpoint: ENDPOINT = DEFAULT_ENDPOINT) -> None:
    """Have the controller check a plan, place it at the entry it has registered, and load it.

    Example: `rtctl plan load plan.json`
    """
    from rtctl import plan_file

    content = plan_file.load(file)
    with connect(robot, endpoint) as client:
        reply = client.plan(plan_file.document(content))
    say(f"plan {reply.result.get('number')} is in force from tick {reply.tick}")


def _accepted(settings: "Settings", known: "Plan", entry: tuple[float, float, float] | None) -> "np.ndarray":
    """The entry pose at which the plan is good; PlanError if it is not."""
    import numpy as np

    from rtctl import robots
    from rtctl.planner import make_plan

    pose_entry = np.array(settings.workflow.entry_pose_mm_rad if entry is None else entry)
    make_plan(settings, robots.load(settings.robot.kind, settings.robot.geometry), pose_entry, 1, known=known)
    return pose_entry


def _entry_of(content: "PlanFile") -> "np.ndarray":
    import numpy as np

    return np.array(content.checked.entry_pose_mm_rad)


def _words(plan: "Plan") -> str:
    return (
        f"{len(plan.depth_mm)} depths to {plan.depth_mm[-1]:g} mm, summed cost {plan.cost.sum():.2f} mm²,"
        f" cochlea A {plan.cochlea.spiral_a_mm:g} mm, {plan.cochlea.side} ear"
    )


def _facts(content: "PlanFile", plan: "Plan") -> dict[str, Any]:
    checked = content.checked
    entry = "  ".join(f"{v:g}" for v in checked.entry_pose_mm_rad)
    return {
        "made": f"{content.made} by {content.program}",
        "robot": f"{content.robot.kind}, geometry {content.robot.geometry}",
        "cochlea": f"A {plan.cochlea.spiral_a_mm:g} mm, {plan.cochlea.side} ear",
        "entry": f"{entry} [mm, mm, rad] in the base frame when it was checked",
        "checked at": f"{checked.insertion_speed_mm_per_s:g} mm/s, recess {checked.recess_angle_rad:.4g} rad and"
        f" {checked.recess_clearance_mm:g} mm, settings {checked.config_hash}",
        "summed cost": f"{plan.cost.sum():.3f} mm²",
    }


def _table(content: "PlanFile", plan: "Plan") -> "Table":
    """A row a depth; poses in {B} at the entry of the file."""
    from rich.table import Table
    from rich.text import Text

    from rtctl.electrode.robot_path import poses_in_base

    table = Table(box=None, header_style="dim", pad_edge=False)
    for head in ("depth [mm]", "x [mm]", "y [mm]", "phi [rad]", "stylet [mm]", "cost [mm²]", "rms [mm]"):
        table.add_column(Text(head), justify="right")
    poses = poses_in_base(plan.pose_in_cochlea, _entry_of(content), plan.cochlea)
    for depth, (x, y, phi), stylet, cost, rms in zip(
        plan.depth_mm, poses, plan.stylet_mm, plan.cost, plan.rms_mm, strict=True
    ):
        table.add_row(
            f"{depth:.1f}", f"{x:.3f}", f"{y:.3f}", f"{phi:.4f}", f"{stylet:.3f}", f"{cost:.5f}", f"{rms:.3f}"
        )
    return table
