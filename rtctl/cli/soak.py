"""``rtctl bench soak``: the daemon under everything at once, for as long as you like."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from rtctl.cli.console import output, remark, say, say_error
from rtctl.cli.exit_codes import Exit
from rtctl.cli.options import DEFAULT_CONFIG, JSON, SET

if TYPE_CHECKING:
    from rtctl.settings import Settings
    from rtctl.soak.run import Noted
    from rtctl.soak.verdicts import Verdict

RESULT = "soak.json"
OUT_OF_REACH = "backend.options.anatomy.entry_in_base_mm=[400.0, 0.0]"
"""An array that is loaded and moved at random runs through bone, which no plant has an answer to: a fault that stays."""


def soak(
    config: Annotated[str, typer.Argument(help="Settings of a simulated backend.")] = DEFAULT_CONFIG,
    minutes: Annotated[float, typer.Option(min=0.1, max=1440.0, help="How long.")] = 10.0,
    seed: Annotated[
        int | None, typer.Option(min=0, help="Of commands, storms and kills; drawn and told without one.")
    ] = None,
    overrides: SET = None,
    json: JSON = False,
    run_directory: Annotated[
        Path | None, typer.Option(help="Folder of this run; by default named by the time.")
    ] = None,
) -> int:
    """Soak the daemon: random commands, parameter sets, client storms and killed gateways, in real time on the plant.

    What must hold is judged promise by promise and written to soak.json in the folder of the run. Exit code 6 if a promise was
    broken. A gigabyte of log for half an hour.

    Example: `rtctl bench soak --minutes 60`
    """
    import secrets

    from hal.backend import load as load_backend
    from rtctl.cli.child import Daemon
    from rtctl.cli.runs import new_directory
    from rtctl.recording import logs_in
    from rtctl.settings import load
    from rtctl.soak import recorded as logs
    from rtctl.soak.run import carry_out
    from rtctl.soak.verdicts import verdicts

    settings = load(config, overrides or ())
    choice = settings.backend
    if not load_backend(choice.name, choice.options, period_s=settings.loop.period_s, seed=0).simulated:
        raise typer.BadParameter("a soak moves the robot at random: give settings of a simulated backend")
    seed = secrets.randbelow(2**31) if seed is None else seed
    overrides = [*(overrides or ()), *_on_a_free_port(), *([OUT_OF_REACH] if choice.name == "plant" else [])]
    settings = load(config, overrides)
    directory = run_directory or new_directory(settings.log.directory)
    remark(f"soaking for {minutes:g} min with --seed {seed}, in {directory}")
    with Daemon(settings, config, overrides, seed, directory) as daemon:
        daemon.wait_until_ready()
        noted = carry_out(settings, daemon.pid, directory, 60.0 * minutes, seed, remark)
    assert daemon.exit_code is not None
    remark("reading the logs and replaying them")
    recorded = logs.read(logs_in(directory), noted.outages)
    found = verdicts(noted, recorded, daemon.exit_code)
    table = _as_table(settings, noted, found)
    (directory / RESULT).write_text(_encoded(table))
    if json:
        say(_encoded(table))
    else:
        output().print(_words(found))
        say(f"seed {seed}; result: {directory / RESULT}")
    if all(v.good for v in found):
        return Exit.OK
    say_error(f"not kept: {'; '.join(v.name for v in found if not v.good)}")
    return Exit.DATA


def _on_a_free_port() -> list[str]:
    """A robot and an endpoint of its own, so that no other controller on this machine is stormed."""
    import os
    import socket

    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    return [f"robot.name=soak{os.getpid()}", f"gateway.endpoint=tcp/127.0.0.1:{port}"]


def _words(found: "list[Verdict]") -> Any:
    from rich.table import Table

    table = Table(box=None, pad_edge=False)
    for head in ("promise", "kept", "figures"):
        table.add_column(head)
    for v in found:
        table.add_row(v.name, "yes" if v.good else "NO", v.figures)
    return table


def _as_table(settings: "Settings", noted: "Noted", found: "list[Verdict]") -> dict[str, Any]:
    from dataclasses import asdict

    from hal.kernel import kernel_hash
    from rtctl.settings import config_hash

    storms = [{k: v for k, v in s.items() if k != "unanswered_ns"} for s in noted.storms]
    return {
        "seed": noted.seed, "seconds": noted.seconds, "config_hash": config_hash(settings), "kernel_hash": kernel_hash(),
        "kept": all(v.good for v in found), "promises": [asdict(v) for v in found], "operator": noted.outcomes,
        "storms": storms, "outages": [asdict(o) for o in noted.outages],
        "last_status": noted.status,
    }  # fmt: skip


def _encoded(table: Any) -> str:
    from json import dumps

    return dumps(table, indent=1)
