"""``rtctl run`` and ``rtctl demo``: the controller as a daemon, and a whole insertion with it."""

from pathlib import Path
from typing import Annotated

import typer

from rtctl.cli.options import CONFIG, DEFAULT_CONFIG, RUN, SEED, SET

RUN_DIRECTORY = Annotated[
    Path | None, typer.Option(help="Folder of this run; by default one named by the time in log.directory.")
]
BEST_EFFORT = Annotated[
    bool, typer.Option("--allow-best-effort", help="Arm hardware although the machine does not grant real time.")
]


def add_to(app: typer.Typer) -> None:
    """Add the commands."""
    app.command(rich_help_panel=RUN)(run)
    app.command(rich_help_panel=RUN)(demo)


def run(
    config: CONFIG,
    gateway: Annotated[
        bool, typer.Option("--gateway/--no-gateway", help="Serve the network and write the log.")
    ] = True,
    duration: Annotated[float | None, typer.Option(help="End after so many seconds.", min=0.001)] = None,
    seed: SEED = 0,
    overrides: SET = None,
    run_directory: RUN_DIRECTORY = None,
    allow_best_effort: BEST_EFFORT = False,
) -> int:
    """Run the controller: the real-time process and, beside it, the gateway. SIGTERM or Ctrl-C ends it safely.

    Example: `rtctl run planar-sim --duration 60`
    """
    from rtctl import daemon
    from rtctl.cli.runs import new_directory
    from rtctl.settings import load

    extra = ["loop.allow_best_effort=true"] if allow_best_effort else []
    settings = load(config, [*(overrides or ()), *extra])
    directory = run_directory or new_directory(settings.log.directory)
    return daemon.run(settings, run_directory=directory, seed=seed, gateway=gateway, duration_s=duration)


def demo(
    config: CONFIG = DEFAULT_CONFIG,
    seed: SEED = 0,
    overrides: SET = None,
    run_directory: RUN_DIRECTORY = None,
) -> int:
    """Start the daemon, do a whole insertion with it, and report: the work-flow of a surgery on the simulated bench.

    Exit code 0 only if the depth was reached without a fault and nothing was lost.

    Example: `rtctl demo planar-sim`
    """
    from rtctl.cli.insertion import insert_through_daemon
    from rtctl.cli.runs import new_directory
    from rtctl.settings import load

    settings = load(config, overrides or ())
    directory = run_directory or new_directory(settings.log.directory)
    code, _ = insert_through_daemon(settings, config, overrides or [], seed, directory)
    return code
