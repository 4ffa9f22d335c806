"""``rtctl operate``: driving by hand. `follow` moves the robot; the others only publish what a device says."""

import contextlib
import os
import signal
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rtctl.cli.connection import connect, credentials
from rtctl.cli.console import remark, say
from rtctl.cli.exit_codes import Exit
from rtctl.cli.options import DEFAULT_ENDPOINT, DEFAULT_ROBOT, ENDPOINT, OPERATE, ROBOT

if TYPE_CHECKING:
    from rtctl.operator.hand_devices import Layout
    from rtctl.operator.publisher import Device

REPLY_S = 0.2
"""How long the bridge waits for the controller; what it sent has died long before."""

SPEED = Annotated[float, typer.Option(help="Speed of a key or of full deflection [mm/s].", min=0.01, max=100.0)]
TURN = Annotated[float, typer.Option(help="The same for turning [rad/s].", min=0.001, max=10.0)]
IN_BASE = Annotated[bool, typer.Option("--base-frame", help="Move along the axes of {B} instead of the gripper's.")]
DEVICE = Annotated[
    Path | None, typer.Option(help="Event device, like /dev/input/event5; found by itself if there is one.")
]


def add_to(app: typer.Typer) -> None:
    """Add the commands."""
    group = typer.Typer(help="Drive by hand, with a deadman.", no_args_is_help=True)
    group.command()(follow)
    group.command()(keyboard)
    group.command()(gamepad)
    group.command(name="space-mouse")(space_mouse)
    app.add_typer(group, name="operate", rich_help_panel=OPERATE)


def follow(
    speed: Annotated[float, typer.Option(help="Fastest translation [mm/s].", min=0.01, max=50.0)] = 2.0,
    turn: Annotated[float, typer.Option(help="Fastest rotation [rad/s].", min=0.001, max=2.0)] = 0.1,
    stage: Annotated[int, typer.Option(help="Speed stage to begin with: 10, 25, 50 or 100 %.", min=1, max=4)] = 2,
    step: Annotated[
        float, typer.Option(help="Way along the path at a press of insert [mm].", min=0.01, max=1.0)
    ] = 0.25,
    age: Annotated[int, typer.Option(help="Oldest message that counts [ms].", min=50, max=100)] = 80,
    robot: ROBOT = DEFAULT_ROBOT,
    endpoint: ENDPOINT = DEFAULT_ENDPOINT,
) -> int:
    """Hold the lease and follow the messages of a device while its deadman is held, until Ctrl-C.

    Example: `rtctl operate follow --speed 1`
    """
    import zenoh

    from rtctl.client import open_session
    from rtctl.gateway.keys import OPERATOR_TWIST
    from rtctl.operator.follower import Follower
    from rtctl.operator.link import Link
    from rtctl.operator.motion import Limits, Projection

    signal.signal(signal.SIGTERM, signal.default_int_handler)  # to be asked to end is no reason to leave it moving
    with connect(robot, endpoint) as client:
        names = "trajectory.speed_mm_per_s", "trajectory.speed_rad_per_s", "workflow.speed_mm_per_s"
        of_controller = client.parameters(*names)
        limits = Limits(min(speed, of_controller[names[0]]), min(turn, of_controller[names[1]]))
        projection = Projection(client.status()["kind"], limits)
        client.acquire()
        client.wait(lambda _: True, 5.0, what="a record")
        client.timeout_s = REPLY_S
        link = Link(age / 1e3)

        def receive(sample: zenoh.Sample) -> None:
            link.receive(sample.payload.to_bytes(), time.monotonic(), time.time_ns())

        with open_session(endpoint, *credentials()) as session:
            subscriber = session.declare_subscriber(f"rtctl/{robot}/{OPERATOR_TWIST}", receive)
            say("following; press Ctrl-C to end")
            follower = Follower(
                client,
                link,
                projection,
                say,
                stage=stage - 1,
                step_mm=step,
                path_speed_mm_per_s=of_controller[names[2]],
            )
            with contextlib.suppress(KeyboardInterrupt):  # the way to end it
                follower.run(lambda: False)
            subscriber.undeclare()
    return Exit.OK


def keyboard(
    speed: SPEED = 2.0,
    turn: TURN = 0.1,
    base_frame: IN_BASE = False,
    robot: ROBOT = DEFAULT_ROBOT,
    endpoint: ENDPOINT = DEFAULT_ENDPOINT,
) -> int:
    """Publish what the keys of this terminal say: a key counts as held while the terminal repeats it.

    Example: `rtctl operate keyboard --speed 1`
    """
    from rtctl.operator.keyboard import HELP, Keyboard

    with ended_by_signals(), Keyboard(sys.stdin.fileno(), speed, turn) as device:
        remark(HELP)
        _publish(device, "keyboard", base_frame, robot, endpoint)
    return Exit.OK


def gamepad(
    device: DEVICE = None,
    speed: SPEED = 2.0,
    turn: TURN = 0.1,
    base_frame: IN_BASE = False,
    robot: ROBOT = DEFAULT_ROBOT,
    endpoint: ENDPOINT = DEFAULT_ENDPOINT,
) -> int:
    """Publish what a game controller says; its right shoulder button is the deadman.

    Example: `rtctl operate gamepad --device /dev/input/event5`
    """
    from rtctl.operator.hand_devices import GAMEPAD

    return _hand_device(GAMEPAD, device, (speed, turn), base_frame, robot, endpoint)


def space_mouse(
    device: DEVICE = None,
    speed: SPEED = 2.0,
    turn: TURN = 0.1,
    base_frame: IN_BASE = False,
    robot: ROBOT = DEFAULT_ROBOT,
    endpoint: ENDPOINT = DEFAULT_ENDPOINT,
) -> int:
    """Publish what a 3-D mouse says; its left button is the deadman.

    Example: `rtctl operate space-mouse --speed 1`
    """
    from rtctl.operator.hand_devices import SPACE_MOUSE

    return _hand_device(SPACE_MOUSE, device, (speed, turn), base_frame, robot, endpoint)


@contextlib.contextmanager
def ended_by_signals() -> Iterator[None]:
    """Being asked to end is Ctrl-C, the way to end a device; what it changed is put back."""
    for number in (signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, signal.default_int_handler)
    with contextlib.suppress(KeyboardInterrupt):
        yield


def _hand_device(
    layout: "Layout", path: Path | None, speeds: tuple[float, float], base_frame: bool, robot: str, endpoint: str
) -> int:
    from rtctl.operator.hand_devices import HandDevice, find
    from rtctl.operator.input_events import EventDevice

    with ended_by_signals(), EventDevice.open(path or find(layout)) as events:
        _publish(HandDevice(events, layout, *speeds), layout.name, base_frame, robot, endpoint)
    return Exit.OK


def _publish(device: "Device", name: str, base_frame: bool, robot: str, endpoint: str) -> None:
    from rtctl.operator.publisher import Publisher, publish

    with Publisher(robot, endpoint, name, "base" if base_frame else "gripper", *credentials()) as publisher:
        remark(f"publishing; `rtctl operate follow` moves the robot (process {os.getpid()})")
        publish(device, publisher.send)
