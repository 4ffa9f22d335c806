"""``rtctl sim``: the scripted insertion in lockstep, without sockets and without waiting."""

from pathlib import Path
from typing import Annotated

import typer

from rtctl.cli.console import grid, output, say, say_error
from rtctl.cli.options import CONFIG, DEFAULT_CONFIG, JSON, RUN, SEED, SET
from rtctl.cli.outcome import exit_code, key_figures
from rtctl.cli.progress import shown


def add_to(app: typer.Typer) -> None:
    """Add the command."""
    app.command(rich_help_panel=RUN)(sim)


def sim(
    config: CONFIG = DEFAULT_CONFIG,
    seed: SEED = 0,
    overrides: SET = None,
    json: JSON = False,
    log: Annotated[Path | None, typer.Option(help="Write the run to this MCAP file.", dir_okay=False)] = None,
    report: Annotated[Path | None, typer.Option(help="Write report.html and pictures to this folder.")] = None,
) -> int:
    """Simulate a whole insertion in lockstep: virtual clock, no sockets, the same result every time.

    Example: `rtctl sim planar-sim --seed 3 --set admittance.lateral=false --json`
    """
    from json import dumps

    from rtctl import settings, summary
    from rtctl.simulation import simulate

    chosen = settings.load(config, overrides or ())
    with shown(quiet=json) as progress:
        result = simulate(chosen, seed, log=log, report=progress)
    if report is not None:
        from rtctl import report as reports

        figures = reports.render(result.recording, report, wall_s=result.wall_s)
    else:
        figures = summary.summarise(result.recording, result.wall_s)
    if json:
        say(dumps(figures, indent=2, ensure_ascii=False))
    else:
        output().print(grid(key_figures(figures)))
        for what, path in (("log", log), ("report", report and report / "report.html")):
            if path is not None:
                say(f"{what}: {path}")
    if result.failure is not None:
        say_error(str(result.failure))
    return exit_code(figures, result.failure)
