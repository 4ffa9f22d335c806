"""Verbs that ask one thing of a running controller."""

from collections.abc import Callable
from typing import Annotated

import typer

from rtctl.cli.connection import ClientOperator, connect, stopping
from rtctl.cli.console import say
from rtctl.cli.options import DEFAULT_ENDPOINT, DEFAULT_ROBOT, ENDPOINT, OPERATE, ROBOT
from rtctl.cli.waiting import until_at_rest

AT_ONCE: dict[str, tuple[str, str]] = {
    "enable": ("ENABLE", "Energise the amplifiers and hold the pose."),
    "disable": ("DISABLE", "Remove power; the robot stays where it is."),
    "pause": ("PAUSE", "Brake; nothing moves until `rtctl resume`."),
    "resume": ("RESUME", "Go on with what was paused."),
    "stop": ("STOP", "Brake and hold. Anybody may, without the lease."),
    "ack": ("ACKNOWLEDGE", "Leave the fault state, once its cause is gone."),
    "register": ("REGISTER_ENTRY", "Take the present gripper pose as the entry into the cochlea."),
    "load-array": ("LOAD_ARRAY", "Tell the controller that an array is in the gripper."),
    "unload-array": ("UNLOAD_ARRAY", "Tell the controller that the gripper is empty."),
}
"""Command -> verb and meaning."""

LONGEST_S = 120.0


def add_to(app: typer.Typer) -> None:
    """Add the commands."""
    for name, (verb, meaning) in AT_ONCE.items():
        app.command(name=name, rich_help_panel=OPERATE, help=f"{meaning}\n\nExample: `rtctl {name}`")(_at_once(verb))
    app.command(rich_help_panel=OPERATE)(home)
    app.command(rich_help_panel=OPERATE)(unbias)


def _at_once(verb: str) -> Callable[..., None]:
    """The command that sends `verb` and tells the tick at which it took effect."""

    def command(robot: ROBOT = DEFAULT_ROBOT, endpoint: ENDPOINT = DEFAULT_ENDPOINT) -> None:
        from rtctl.commands import Verb

        with connect(robot, endpoint) as client:
            reply = client.command(Verb[verb])
        say(f"{verb.lower()} accepted, tick {reply.tick}")

    return command


def home(
    robot: ROBOT = DEFAULT_ROBOT,
    endpoint: ENDPOINT = DEFAULT_ENDPOINT,
    timeout: Annotated[float, typer.Option(help="Longest time to wait [s].", min=1.0)] = LONGEST_S,
) -> int:
    """Find the end stops, so that motor angles mean a pose; waits until done.

    Example: `rtctl home`
    """
    from rtctl.commands import Verb

    with connect(robot, endpoint) as client, stopping(client):
        operator = ClientOperator(client)
        return until_at_rest(operator, "home", operator.command(Verb.HOME), timeout, lambda r: bool(r["is_homed"]))


def unbias(robot: ROBOT = DEFAULT_ROBOT, endpoint: ENDPOINT = DEFAULT_ENDPOINT) -> int:
    """Take the present force as zero; waits until the average is taken.

    Example: `rtctl unbias`
    """
    from rtctl.commands import Verb

    with connect(robot, endpoint) as client:
        operator = ClientOperator(client)
        return until_at_rest(
            operator, "unbias", operator.command(Verb.UNBIAS), LONGEST_S, lambda r: bool(r["is_unbiased"])
        )
