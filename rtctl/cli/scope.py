"""``rtctl scope``: captures at the full rate around a trigger."""

import contextlib
import math
import sys
import time
from collections.abc import Generator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rtctl.cli.connection import connect
from rtctl.cli.console import output, remark, say, say_error
from rtctl.cli.exit_codes import Exit
from rtctl.cli.options import DEFAULT_ENDPOINT, DEFAULT_ROBOT, ENDPOINT, ROBOT, WATCH

if TYPE_CHECKING:
    from rtctl.scope.capture import Capture
    from rtctl.scope.client import RemoteScope
    from rtctl.scope.setup import Setup, Trigger

POLL_S = 0.1
STATES = {
    "filling": "collects the {setup.pre} samples before the trigger",
    "waiting": "waits for {setup.trigger}",
    "triggered": "triggered, {filled} of {setup.samples} samples",
}
"""What is told of a state."""


def add_to(app: typer.Typer) -> None:
    """Add the command."""
    app.command(rich_help_panel=WATCH)(scope)


def scope(
    signals: Annotated[list[str], typer.Argument(help="Signals: force_axial_n, wrench_in_base[2], truth.tip ...")],
    trigger: Annotated[str, typer.Option(help="Wait for a level, as in 'force_axial_n < -0.05'.")] = "",
    edge: Annotated[str, typer.Option(help="Wait for the edge at that level: falling, rising or either.")] = "",
    event: Annotated[
        str, typer.Option(help="Wait for an event: condition:overrun, command:insert, state:fault, task:inserting ...")
    ] = "",
    fault: Annotated[bool, typer.Option("--fault", help="Wait for a fault.")] = False,
    manual: Annotated[bool, typer.Option("--manual", help="Wait for the Enter key.")] = False,
    auto: Annotated[
        bool, typer.Option("--auto", help="Capture also when the trigger stays away for as long as a capture takes.")
    ] = False,
    samples: Annotated[int, typer.Option(help="Length of a capture.", min=1)] = 1000,
    pre: Annotated[int, typer.Option(help="How many of them before the trigger.", min=0)] = 0,
    decimation: Annotated[int, typer.Option(help="Keep one of so many ticks; the trigger looks at all.", min=1)] = 1,
    captures: Annotated[int, typer.Option(help="How many captures.", min=1)] = 1,
    to: Annotated[Path | None, typer.Option("--output", help="File for them: .mcap, .csv or .npy.")] = None,
    plot: Annotated[Path | None, typer.Option(help="Draw them: .svg or .png.")] = None,
    log: Annotated[Path | None, typer.Option(help="Look in the log, or the folder, of a run instead.")] = None,
    timeout: Annotated[
        float | None, typer.Option(help="Longest time to wait for each [s]; for ever by default.", min=0.1)
    ] = None,
    robot: ROBOT = DEFAULT_ROBOT,
    endpoint: ENDPOINT = DEFAULT_ENDPOINT,
) -> int:
    """Capture signals at the full rate around a trigger: at once, at a level, an edge, an event, a fault, or by hand.

    Ctrl-C ends it and keeps what is finished. Exit code 1 if there are fewer captures than asked for.

    Example: `rtctl scope force_axial_n depth_mm --trigger 'force_axial_n < -0.05' --edge falling --pre 200 --output x.mcap`
    """  # fmt: skip
    from rtctl.scope.files import check
    from rtctl.scope.setup import make_setup

    setup = make_setup(
        signals=signals, trigger=_trigger(trigger, edge, event, fault, manual), auto=auto, samples=samples, pre=pre,
        decimation=decimation, captures=captures,
    )  # fmt: skip
    if to is not None:
        check(to)
    found: list[Capture] = []
    try:
        with contextlib.closing(_live(setup, robot, endpoint, timeout) if log is None else _logged(setup, log)) as all_:
            for capture in all_:
                found.append(capture)
                remark(f"capture {len(found)} of {captures}: {_words(capture)}")
    except KeyboardInterrupt:
        _keep(found, to, plot)
        raise
    _keep(found, to, plot)
    if len(found) < captures:
        say_error(f"{len(found)} of {captures} captures of {setup.trigger}")
        return Exit.FAILED
    return Exit.OK


def _trigger(expression: str, edge: str, event: str, fault: bool, manual: bool) -> "Trigger":
    """The one trigger among the options.

    Raises:
        ScopeError: more than one, or none that is understood.
    """
    from rtctl.scope.setup import FAULT, Event, Free, Manual, ScopeError, parse_trigger

    given = [name for name, value in (("--trigger", expression), ("--event", event), ("--fault", fault), ("--manual", manual)) if value]  # fmt: skip
    if len(given) > 1:
        raise ScopeError("a scope has one trigger", value=" and ".join(given), remedy="choose one of them")
    if edge and not expression:
        raise ScopeError("an edge of nothing", value=edge, remedy="say at which level: --trigger 'SIGNAL < NUMBER'")
    if expression:
        return parse_trigger(expression, edge)
    if event:
        return Event(event)
    return FAULT if fault else Manual() if manual else Free()


def _live(setup: "Setup", robot: str, endpoint: str, timeout_s: float | None) -> "Generator[Capture, None, None]":
    """Captures of a running controller, as they come; fewer than asked for if one takes too long."""
    from msgspec.structs import asdict

    from rtctl.scope.client import NoCapture
    from rtctl.scope.setup import Manual

    with connect(robot, endpoint) as client, client.scope(**asdict(setup)) as scope:
        for _ in range(setup.captures):
            if isinstance(setup.trigger, Manual):
                remark("scope: press Enter to capture")
                if not sys.stdin.readline():
                    say_error("nobody is there to press Enter")
                    return
                scope.force()
            try:
                yield _next(scope, timeout_s)
            except NoCapture as error:
                say_error(str(error))
                return


def _next(scope: "RemoteScope", timeout_s: float | None) -> "Capture":
    """The next capture, while every change of state is told."""
    from rtctl.scope.client import NoCapture

    until = math.inf if timeout_s is None else time.monotonic() + timeout_s
    told = ""
    while True:
        state, filled, _ = scope.progress
        if state in STATES and state != told:
            told = state
            remark("scope: " + STATES[state].format(setup=scope.setup, filled=filled))
        try:
            return scope.wait(POLL_S)
        except NoCapture as error:
            if time.monotonic() >= until:
                raise NoCapture(error.what, bound=f"within {timeout_s:g} s", remedy=error.remedy) from None


def _logged(setup: "Setup", run: Path) -> "Generator[Capture, None, None]":
    """Captures of the log of a run."""
    from rtctl.log.reader import open_many
    from rtctl.recording import logs_in
    from rtctl.scope.offline import captures_of

    yield from captures_of(open_many(logs_in(run) if run.is_dir() else [run]), setup)


def _words(capture: "Capture") -> str:
    """Where a capture was triggered and what is missing in it."""
    how = "" if capture.cause == "trigger" else f", {capture.cause}"
    words = f"tick {capture.trigger_tick}{how}, {len(capture)} samples from {capture.time_s[0]:.3f} to {capture.time_s[-1]:.3f} s"
    if not capture.complete:
        words += ", cut short by the end of the records"
    if capture.missed_ticks or capture.lost_records:
        words += (
            f", {capture.missed_ticks} grid points missed by the loop and {capture.lost_records} records lost inside"
        )
    return words


def _keep(captures: "list[Capture]", to: Path | None, plot: Path | None) -> None:
    """Files, pictures, and the range of every signal."""
    import numpy as np
    from rich.table import Table

    from rtctl.scope.files import save

    if not captures:
        return
    table = Table("signal", "unit", "smallest", "largest", box=None)
    for s in captures[0].signals:
        values = np.concatenate([c[s.name].ravel() for c in captures])
        known = values[np.isfinite(values)]
        table.add_row(s.name, s.unit, *(f"{v:.6g}" for v in (known.min(), known.max())) if len(known) else ("–", "–"))
    output().print(table)
    if to is not None:
        save(captures, to)
        say(f"captures: {to}")
    if plot is not None:
        from rtctl.scope.picture import draw

        draw(captures, plot)
        say(f"picture: {plot}")
