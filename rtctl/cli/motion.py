"""Verbs that move the robot and wait for its end; Ctrl-C stops it first."""

import math
import time
from typing import TYPE_CHECKING, Annotated

import typer

from hal.errors import OptionError
from rtctl.cli.connection import ClientOperator, connect, stopping
from rtctl.cli.console import say
from rtctl.cli.exit_codes import Exit
from rtctl.cli.options import DEFAULT_ENDPOINT, DEFAULT_ROBOT, ENDPOINT, NUMBERS, OPERATE, ROBOT
from rtctl.cli.progress import shown
from rtctl.cli.waiting import until_at_rest

if TYPE_CHECKING:
    from rtctl.client import Client

STREAM_PERIOD_S = 0.02
"""Time between two commands of a stream; the controller stops after 50 ms of silence."""
LONGEST_S = 120.0

POSE = Annotated[list[float], typer.Argument(help="One number for every coordinate of the pose.", metavar="NUMBER...")]
TIMEOUT = Annotated[float, typer.Option(help="Longest time to wait [s].", min=1.0)]


def add_to(app: typer.Typer) -> None:
    """Add the commands."""
    app.command(context_settings=NUMBERS, rich_help_panel=OPERATE)(move)
    app.command(context_settings=NUMBERS, rich_help_panel=OPERATE)(servo)
    app.command(rich_help_panel=OPERATE)(approach)
    app.command(rich_help_panel=OPERATE)(insert)
    app.command(rich_help_panel=OPERATE)(retract)


def move(
    pose: POSE,
    robot: ROBOT = DEFAULT_ROBOT,
    endpoint: ENDPOINT = DEFAULT_ENDPOINT,
    timeout: TIMEOUT = LONGEST_S,
) -> int:
    """Move the gripper straight to a pose in the base frame [mm, rad] and wait until it is there.

    Example: `rtctl move 165 -2 0.05`
    """
    from rtctl.commands import Verb

    with connect(robot, endpoint) as client, stopping(client):
        operator = ClientOperator(client)
        return until_at_rest(operator, "move", operator.command(Verb.MOVE_CP, *pose), timeout)


def servo(
    numbers: POSE,
    velocity: Annotated[bool, typer.Option("--velocity", help="NUMBER... is a rate [mm/s, rad/s].")] = False,
    pose: Annotated[bool, typer.Option("--pose", help="NUMBER... is a pose [mm, rad].")] = False,
    seconds: Annotated[float, typer.Option(help="How long to stream.", min=0.02, max=600.0)] = 1.0,
    robot: ROBOT = DEFAULT_ROBOT,
    endpoint: ENDPOINT = DEFAULT_ENDPOINT,
) -> int:
    """Stream a velocity or a pose for some seconds, then stop: what a teleoperation console does.

    Example: `rtctl servo --velocity 1 -0.5 0 --seconds 2`
    """
    from rtctl.commands import Verb

    if velocity == pose:
        raise typer.BadParameter("give either --velocity or --pose")
    verb = Verb.SERVO_CV if velocity else Verb.SERVO_CP
    with connect(robot, endpoint) as client, stopping(client):
        sent = 0
        begin = time.monotonic()
        while (now := time.monotonic()) - begin < seconds:
            client.command(verb, *numbers, valid_for_s=2 * STREAM_PERIOD_S)
            sent += 1
            time.sleep(max(0.0, STREAM_PERIOD_S - (time.monotonic() - now)))
        tick = client.stop().tick or 0
        operator = ClientOperator(client)
        operator.wait(lambda r: r["tick"] >= tick and not r["is_busy"], LONGEST_S)
    say(f"servo: done, {sent} commands in {seconds:g} s")
    return Exit.OK


def approach(robot: ROBOT = DEFAULT_ROBOT, endpoint: ENDPOINT = DEFAULT_ENDPOINT, timeout: TIMEOUT = LONGEST_S) -> int:
    """Move to the first pose of the plan and wait until it is there.

    Example: `rtctl approach`
    """
    from rtctl.commands import Verb
    from rtctl.lifecycle import Task

    with connect(robot, endpoint) as client, stopping(client):
        operator = ClientOperator(client)
        tick = operator.command(Verb.APPROACH)
        return until_at_rest(operator, "approach", tick, timeout, lambda r: r["task_state"] == Task.AT_ENTRY)


def insert(
    depth: Annotated[float | None, typer.Argument(help="Depth [mm]; workflow.depth_mm by default.")] = None,
    speed: Annotated[float | None, typer.Argument(help="Speed [mm/s]; workflow.speed_mm_per_s by default.")] = None,
    robot: ROBOT = DEFAULT_ROBOT,
    endpoint: ENDPOINT = DEFAULT_ENDPOINT,
) -> int:
    """Insert the array to a depth and wait: plans first if there is no plan, and approaches if not at the entry.

    Example: `rtctl insert 12 0.5`
    """
    from rtctl.lifecycle import Task
    from rtctl.workflow import Script

    with connect(robot, endpoint) as client, shown() as progress, stopping(client):
        depth_mm, speed_mm_per_s = _depth_and_speed(client, depth, speed, "workflow.depth_mm")
        record = client.wait(lambda _: True, 5.0, what="a record")
        steps = ["insert"]
        if record["task_state"] not in (Task.AT_ENTRY, Task.HOLDING):
            steps.insert(0, "approach")
        if record["plan_number"] == 0:
            steps = ["plan", "approach", "insert"]
        script = Script(ClientOperator(client), progress, tuple(steps))
        if "plan" in steps:
            script.plan()
        if "approach" in steps:
            script.approach()
        script.insert(depth_mm, speed_mm_per_s)
    say(f"inserted to {depth_mm:g} mm")
    return Exit.OK


def retract(
    depth: Annotated[float, typer.Argument(help="Depth to go back to [mm].")] = 0.0,
    speed: Annotated[float | None, typer.Argument(help="Speed [mm/s]; workflow.speed_mm_per_s by default.")] = None,
    robot: ROBOT = DEFAULT_ROBOT,
    endpoint: ENDPOINT = DEFAULT_ENDPOINT,
    timeout: TIMEOUT = LONGEST_S,
) -> int:
    """Go back along the path of the insertion and wait; the stylet stays where it is.

    Example: `rtctl retract 5 1`
    """
    from rtctl.commands import Verb

    with connect(robot, endpoint) as client, stopping(client):
        depth_mm, speed_mm_per_s = _depth_and_speed(client, depth, speed, "")
        operator = ClientOperator(client)
        tick = operator.command(Verb.RETRACT, depth_mm, speed_mm_per_s)
        return until_at_rest(operator, "retract", tick, timeout, lambda r: r["depth_mm"] <= depth_mm + 1e-6)


def _depth_and_speed(
    client: "Client", depth: float | None, speed: float | None, depth_name: str
) -> tuple[float, float]:
    """What was asked for, or else what the settings of the controller say."""
    if depth is None:
        depth = float(client.parameters(depth_name)[depth_name])
    if speed is None:
        name = "workflow.speed_mm_per_s"
        speed = float(client.parameters(name)[name])
    for what, value in (("depth", depth), ("speed", speed)):
        if not math.isfinite(value):  # before anything is planned or approached
            raise OptionError(f"the {what} must be a finite number", value=value)
    return depth, speed
