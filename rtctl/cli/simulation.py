"""``rtctl sim``: the scripted insertion in lockstep, without sockets and without waiting; one, or many."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rtctl.cli import trial
from rtctl.cli.console import grid, output, say, say_error
from rtctl.cli.options import CONFIG, DEFAULT_CONFIG, JSON, RUN, SEED, SET
from rtctl.cli.outcome import exit_code, key_figures
from rtctl.cli.progress import shown

if TYPE_CHECKING:
    from rtctl.settings import Settings

MANY = "Many insertions"


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
    plan: Annotated[
        Path | None, typer.Option(help="Insert along the plan in this file instead of planning.", dir_okay=False)
    ] = None,
    specimen: trial.SPECIMEN = None,
    size: trial.SIZE = None,
    side: trial.SIDE_OF_HEAD = None,
    lateral: trial.LATERAL = None,
    out_of_plane: trial.OUT_OF_PLANE = None,
    angle: trial.ANGLE = None,
    stylet_offset: trial.STYLET_OFFSET = None,
    speed: trial.SPEED = None,
    scatter: trial.SCATTER = None,
    count: Annotated[
        int | None,
        typer.Option(min=1, help="Simulate so many insertions, with the seeds from --seed on.", rich_help_panel=MANY),
    ] = None,
    to: Annotated[
        Path | None,
        typer.Option(
            help="Their table (CSV), a row each; what is in it already is not run again.",
            dir_okay=False,
            rich_help_panel=MANY,
        ),
    ] = None,
    logs: Annotated[
        Path | None,
        typer.Option(help="Folder for their logs, SEED.mcap, 30 MB each.", file_okay=False, rich_help_panel=MANY),
    ] = None,
    jobs: Annotated[
        int | None,
        typer.Option(min=1, max=1024, help="Processes to run them in; 1 by default.", rich_help_panel=MANY),
    ] = None,
) -> int:
    """Simulate a whole insertion in lockstep: virtual clock, no sockets, the same result every time.

    Example: `rtctl sim planar-sim --seed 3 --side left --lateral 0.2 --json`

    With --count many insertions into scattered specimens, each told in a row of a table; the same command goes on with
    a table that was interrupted.

    Example: `rtctl sim --count 200 --jobs 2 --specimen bone --to bone.csv`
    """
    if count is None and (to or jobs or logs):
        raise typer.BadParameter("--to, --logs and --jobs belong to many insertions: give --count too")
    if count is not None and (json or log or report or plan):
        raise typer.BadParameter("--json, --log, --report and --plan are for one insertion: leave out --count, or them")
    if count is not None and (to is None or to.suffix == ".parquet"):
        raise typer.BadParameter("--count needs a table to write to, as CSV: --to FILE.csv")
    given = {
        "--specimen": specimen, "--size": size, "--side": side, "--lateral": lateral, "--out-of-plane": out_of_plane,
        "--angle": angle, "--stylet-offset": stylet_offset, "--speed": speed, "--scatter": scatter,
    }  # fmt: skip
    if count is not None and scatter is None and not trial.is_set("--scatter", overrides or []):
        given["--scatter"] = True
    chosen = trial.settings_with(config, overrides or [], given)
    if count is not None and to is not None:
        from rtctl.cli import campaign

        return campaign.run(chosen, seed, count, jobs or 1, to, logs)
    return one(chosen, seed, json, log, report, plan)


def one(
    chosen: "Settings", seed: int, json: bool, log: Path | None, report: Path | None, plan: Path | None = None
) -> int:
    """Simulate one insertion and tell what it came to."""
    from json import dumps

    from rtctl import plan_file, summary
    from rtctl.simulation import simulate

    known = None if plan is None else plan_file.known_plan(chosen, plan_file.load(plan))
    with shown(quiet=json) as progress:
        result = simulate(chosen, seed, log=log, report=progress, plan=known)
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
