"""``rtctl status`` and ``rtctl watch``: how the controller is doing."""

import time
from typing import TYPE_CHECKING, Annotated, Any

import typer

from rtctl.cli.connection import connect
from rtctl.cli.console import grid, output, say
from rtctl.cli.exit_codes import Exit
from rtctl.cli.options import DEFAULT_ENDPOINT, DEFAULT_ROBOT, ENDPOINT, JSON, ROBOT, WATCH

if TYPE_CHECKING:
    from rich.table import Table

RATE_HZ = 10.0
STATUS_S = 0.5
COLOURS = {"ENABLED": "green", "PAUSED": "yellow", "FAULT": "red bold"}


def add_to(app: typer.Typer) -> None:
    """Add the commands."""
    app.command(rich_help_panel=WATCH)(status)
    app.command(rich_help_panel=WATCH)(watch)


def status(robot: ROBOT = DEFAULT_ROBOT, endpoint: ENDPOINT = DEFAULT_ENDPOINT, json: JSON = False) -> int:
    """Tell how the controller is doing, what is wrong, and what to do about it. Exit code 5 in fault.

    Example: `rtctl status`
    """
    import json as encoder

    with connect(robot, endpoint) as client:
        answer = client.status()
    if json:
        say(encoder.dumps(answer, indent=2, ensure_ascii=False))
    else:
        output().print(grid(words(answer)))
    return Exit.FAULT if answer.get("state") == "FAULT" else Exit.OK


def watch(
    robot: ROBOT = DEFAULT_ROBOT,
    endpoint: ENDPOINT = DEFAULT_ENDPOINT,
    seconds: Annotated[float | None, typer.Option(help="How long to watch; until Ctrl-C by default.", min=0.1)] = None,
) -> int:
    """Show pose, depth, force and state as they change, until Ctrl-C.

    Example: `rtctl watch`
    """
    from rich.live import Live

    end = None if seconds is None else time.monotonic() + seconds
    with connect(robot, endpoint) as client:
        answer, asked = client.status(), time.monotonic()
        record = client.wait(lambda _: True, 5.0, what="a record")
        live = Live(view(answer, record), console=output(), auto_refresh=False)
        try:
            if output().is_terminal:
                live.start()
            while end is None or time.monotonic() < end:
                time.sleep(1.0 / RATE_HZ if output().is_terminal else 1.0)
                record = client.latest()
                if time.monotonic() - asked > STATUS_S:
                    answer, asked = client.status(), time.monotonic()
                if output().is_terminal:
                    live.update(view(answer, record), refresh=True)
                else:
                    say(line(answer, record))
        except KeyboardInterrupt:
            pass  # the way to end it
        finally:
            live.stop()
    return Exit.OK


def words(answer: dict[str, Any]) -> dict[str, Any]:
    """The status in the order and the words of an operator."""
    from rich.text import Text

    state = str(answer.get("state", "unknown"))
    rows: dict[str, Any] = {
        "robot": f"{answer['robot']} ({answer['kind']}) on backend {answer['backend']}, {answer['real_time']}",
        "state": Text(state, style=COLOURS.get(state, "")),
        "task": f"{answer.get('task_state', '–')}, motion {answer.get('motion', '–')}",
        "homed": "yes" if answer.get("is_homed") else "no",
        "grade": answer.get("grade", "–"),
        "lease": answer.get("lease_holder") or "free",
        "plan": answer.get("plan_number") or "none",
        "parameter set": answer.get("parameter_set"),
        "overruns": f"{answer['overruns']}, {answer['missed_ticks']} ticks missed, latest {answer['max_lateness_ns'] / 1e3:.0f} µs",
        "log": f"{answer['log']}, {answer['lost_records']} records lost",
    }
    if answer.get("log_failure"):
        rows["log failure"] = Text(answer["log_failure"], style="red")
    cause = answer.get("fault_cause")
    for number, entry in enumerate([*([cause] if cause else []), *answer.get("conditions", ())]):
        rows[f"condition {number + 1}"] = Text(f"{entry['text']}; {entry['remedy']}", style="red")
    return rows


def view(answer: dict[str, Any], record: Any) -> "Table":
    """The live table."""
    state = str(answer.get("state", ""))
    from rich.text import Text

    rows = {
        "state": Text(
            f"{state}  {answer.get('task_state', '')}  {answer.get('motion', '')}", style=COLOURS.get(state, "")
        ),
        **measured(record),
        "lease": answer.get("lease_holder") or "free",
    }
    for number, entry in enumerate(answer.get("conditions", ())):
        rows[f"condition {number + 1}"] = Text(f"{entry['text']}; {entry['remedy']}", style="red")
    return grid(rows, title=f"{answer['robot']}, {answer.get('grade', '')}")


def measured(record: Any) -> dict[str, str]:
    """The numbers of a record that an operator follows."""
    pose = "  ".join(f"{value:9.3f}" for value in record["pose_measured"])
    return {
        "tick": f"{int(record['tick'])}",
        "pose [mm, rad]": pose,
        "depth": f"{float(record['depth_mm']):.2f} of {float(record['depth_goal_mm']):.2f} mm",
        "stylet": f"{float(record['stylet_measured_mm']):.2f} mm",
        "resistance": f"{-1e3 * float(record['force_axial_n']):.1f} mN",
        "lateral force": f"{1e3 * float(record['force_lateral_n']):.1f} mN",
        "tick time": f"{int(record['tick_ns']) / 1e3:.1f} µs, late by {int(record['lateness_ns']) / 1e3:.1f} µs",
    }


def line(answer: dict[str, Any], record: Any) -> str:
    """The same in one line, for files and pipes."""
    numbers = measured(record)
    return f"{answer.get('state', '')} {answer.get('task_state', '')} " + " | ".join(
        f"{name} {' '.join(value.split())}" for name, value in numbers.items()
    )
