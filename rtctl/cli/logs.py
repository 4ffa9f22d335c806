"""``rtctl log``: what was recorded."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from rtctl.cli import comparing
from rtctl.cli.blackboxes import blackbox
from rtctl.cli.console import grid, output, remark, say
from rtctl.cli.exit_codes import Exit
from rtctl.cli.log_files import logs_of
from rtctl.cli.options import JSON, RECORDS

if TYPE_CHECKING:
    from rtctl.log.reader import Log

FILE = Annotated[Path, typer.Argument(help="MCAP file of a run.")]
FILES = Annotated[list[Path], typer.Argument(help="MCAP files of one run, in order, or its folder.")]


def add_to(app: typer.Typer) -> None:
    """Add the commands."""
    group = typer.Typer(help="Look at logs, and repair them.", no_args_is_help=True)
    group.command()(info)
    group.command()(plot)
    group.command()(recover)
    group.command()(comparing.compare)
    group.command()(condense)
    group.command()(blackbox)
    app.add_typer(group, name="log", rich_help_panel=RECORDS)


def info(files: FILES, json: JSON = False) -> int:
    """Tell what is in a log, and whether it is whole. Exit code 6 if records are missing or it was cut short.

    Example: `rtctl log info runs/2026-01-31T10-00-00/log.mcap`
    """
    import json as encoder

    from rtctl.log.info import describe
    from rtctl.log.reader import open_many

    log = open_many(logs_of(files))
    facts = describe(log)
    if json:
        say(encoder.dumps(facts, indent=2, ensure_ascii=False, default=str))
    else:
        output().print(grid(_words(facts, log)))
        if not log.complete:
            remark("the log was cut short: make it whole with `rtctl log recover`")
    return Exit.OK if log.complete and not facts["lost_ticks"] else Exit.DATA


def plot(
    files: FILES,
    to: Annotated[Path | None, typer.Option(help="Folder to write to; beside the log by default.")] = None,
) -> None:
    """Draw the pictures of a run and write its report page.

    Example: `rtctl log plot runs/2026-01-31T10-00-00/log.mcap --to /tmp/report`
    """
    from rtctl import report
    from rtctl.recording import open_recording

    files = logs_of(files)
    directory = to or files[0].parent / f"{files[0].stem}-report"
    report.render(open_recording(files), directory)
    say(f"report: {directory / 'report.html'}")


def recover(
    file: FILE,
    target: Annotated[Path | None, typer.Argument(help="New file; FILE-recovered.mcap by default.")] = None,
) -> None:
    """Make a whole file of a log that was cut short or damaged; the original stays as it is.

    Example: `rtctl log recover runs/2026-01-31T10-00-00/log.mcap`
    """
    from rtctl.log.recover import recover as rewrite

    whole = target or file.with_name(f"{file.stem}-recovered.mcap")
    found = rewrite(file, whole)
    until = "" if found.last_tick is None else f", the last of tick {found.last_tick}"
    say(f"{whole}: {found.rows} rows kept{until}; {found.dropped_bytes} bytes could not be used")


def condense(
    files: FILES,
    to: Annotated[Path, typer.Option(help="The golden log to write; it must not exist.", dir_okay=False)],
) -> None:
    """Keep of a run what a replay needs, and a fingerprint of every output: a golden log, a tenth of the size.

    Example: `rtctl log condense runs/2026-01-31T10-00-00 --to golden.mcap`
    """
    from rtctl.replaying.golden import condense as write

    size_bytes = write(logs_of(files), to)
    say(f"{to}: {size_bytes / 1000:.0f} kB")


def _words(facts: dict[str, Any], log: "Log") -> dict[str, Any]:
    """The description in the order and the words of a reader."""
    words = {
        "files": ", ".join(facts["files"]),
        "size": f"{facts['size_bytes'] / 1e6:.1f} MB{'' if facts['complete'] else ', cut short'}",
        "duration": f"{facts['duration_s']:.2f} s",
        "records": f"{facts['rows']} at {facts['rate_hz']:.1f} Hz, ticks {facts['first_tick']} to {facts['last_tick']}",
        "missed": f"{facts['missed_ticks']} grid points",
        "lost": f"{facts['lost_ticks']} records",
        "topics": ", ".join(f"{topic} {count}" for topic, count in facts["topics"].items()),
    }
    kept = ("grade", "config_hash", "kernel_hash", "seed", "revision", "python", "machine", "certificate")
    return words | {name.replace("_", " "): log.header[name] for name in kept if log.header.get(name)}
