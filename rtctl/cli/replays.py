"""``rtctl replay``: runs again, one or many, with this version or another."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from rtctl.cli.console import output, remark, say, say_error
from rtctl.cli.exit_codes import Exit
from rtctl.cli.log_files import logs_of
from rtctl.cli.options import JSON, RECORDS

if TYPE_CHECKING:
    from rtctl.replay import Replay
    from rtctl.replaying.many import Outcome

MANY, OTHERS = "Many runs", "Other revisions"


def add_to(app: typer.Typer) -> None:
    """Add the command."""
    app.command(rich_help_panel=RECORDS)(replay)


def replay(
    files: Annotated[list[Path] | None, typer.Argument(help="MCAP files of one run, in order, or its folder.")] = None,
    json: JSON = False,
    all_below: Annotated[
        Path | None, typer.Option("--all", help="Replay every run in this folder and below.", rich_help_panel=MANY)
    ] = None,
    jobs: Annotated[
        int | None, typer.Option(min=1, max=1024, help="Processes; all cores by default.", rich_help_panel=MANY)
    ] = None,
    against: Annotated[
        str | None,
        typer.Option(
            metavar="REVISION",
            help="Compare this version with that revision on the inputs of the log; or two revisions, as A..B.",
            rich_help_panel=OTHERS,
        ),
    ] = None,
    bisect: Annotated[
        str | None,
        typer.Option(
            metavar="GOOD",
            help="Find the first commit since GOOD whose outputs differ; or between two, as A..B.",
            rich_help_panel=OTHERS,
        ),
    ] = None,
) -> int:
    """Run the controller again on a log; exit code 0 only if every output is identical to the bit, else 6.

    Example: `rtctl replay runs/2026-01-31T10-00-00/log.mcap`

    With --all every run below a folder, on all cores. What cannot be read is told and counts as different.

    Example: `rtctl replay --all runs --json`

    With --against and --bisect another revision of this git clone gets the same inputs; it is compiled in a temporary
    folder, which takes a minute each.

    Example: `rtctl replay log.mcap --against HEAD~3`
    """
    chosen = [bool(files) and all_below is None, all_below is not None and not files]
    if not any(chosen):
        raise typer.BadParameter("give the files of one run, or --all FOLDER")
    if against and bisect:
        raise typer.BadParameter("--against and --bisect are two questions: give one")
    if all_below is not None and (against or bisect):
        raise typer.BadParameter("--against and --bisect take one run: leave out --all")
    if jobs is not None and all_below is None:
        raise typer.BadParameter("--jobs belongs to --all")
    if all_below is not None:
        return _many(all_below, jobs, json)
    paths = logs_of(files or [])
    if against or bisect:
        from rtctl.cli import revisions

        return revisions.compare(paths, against, json) if against else revisions.bisect(paths, str(bisect), json)
    return _one(paths, json)


def _one(paths: list[Path], json: bool) -> Exit:
    from rtctl import replay as replays

    result = replays.run(paths)
    if json:
        from dataclasses import asdict

        say(_encoded({"identical": result.identical, **asdict(result)}))
    elif result.identical:
        say(f"identical: {result.ticks} ticks, {result.commands} commands")
    _tell(result)
    return Exit.OK if result.identical else Exit.DATA


def _tell(result: "Replay") -> None:
    """What differs, and what was left out, on the side."""
    found = result.difference
    if result.not_compared:
        remark(f"not compared, of another version: {', '.join(result.not_compared)}")
    if found is None:
        return
    logged = "a value of which there is a fingerprint" if found.logged is None else found.logged
    say_error(f"the replay differs: first in tick {found.tick}, signal {found.field}: logged {logged}, replayed {found.replayed}")  # fmt: skip
    if found.others:
        remark(f"in the same tick, further along it: {', '.join(found.others)}")
    if not result.same_kernels:
        remark("the code has changed since the log was written; replay it with the revision in its header")


def _many(directory: Path, jobs: int | None, json: bool) -> Exit:
    from contextlib import closing

    from rich import progress

    from rtctl.cli.console import side
    from rtctl.replaying.many import name_of, replay_all, runs_below

    runs = runs_below(directory)
    outcomes: list[Outcome] = []
    bar = progress.Progress(*progress.Progress.get_default_columns(), progress.MofNCompleteColumn(), console=side(), disable=not side().is_terminal)  # fmt: skip
    task = bar.add_task("runs", total=len(runs))
    with bar, closing(replay_all(runs, directory, jobs)) as results:
        for outcome in results:
            outcomes.append(outcome)
            bar.advance(task)
            if not side().is_terminal:
                remark(f"{len(outcomes):5d}/{len(runs)} {name_of(runs[len(outcomes) - 1], directory)}: {outcome.verdict}")  # fmt: skip
    bad = [o for o in outcomes if not o.good]
    if json:
        say(_encoded({"runs": len(outcomes), "not_identical": len(bad), "outcomes": [o.as_table() for o in outcomes]}))
    else:
        output().print(_table(outcomes))
    if not bad:
        return Exit.OK
    say_error(f"{len(bad)} of {len(outcomes)} runs are not identical")
    return Exit.DATA


def _table(outcomes: "list[Outcome]") -> Any:
    from rich.table import Table

    table = Table(box=None, pad_edge=False)
    for head in ("run", "ticks", "result", "first difference"):
        table.add_column(head, justify="right" if head == "ticks" else "left")
    for o in outcomes:
        d = o.difference
        where = o.error
        if d is not None:
            code = "" if o.same_kernels else "; the code has changed since"
            where = f"{d.field} in tick {d.tick}: logged {'unknown' if d.logged is None else d.logged}, replayed {d.replayed}{code}"  # fmt: skip
        elif o.not_compared:
            where = f"not compared: {', '.join(o.not_compared)}"
        table.add_row(o.run, "" if o.ticks is None else str(o.ticks), o.verdict, where)
    return table


def _encoded(value: Any) -> str:
    from json import dumps

    return dumps(value, indent=2, ensure_ascii=False)
