"""``rtctl certify``: how the loop keeps time on this machine, measured and written down."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from rtctl.cli.console import output, remark, say, say_error, side
from rtctl.cli.exit_codes import Exit
from rtctl.cli.options import CONFIG, DEFAULT_CONFIG, JSON, RUN, SET
from rtctl.readiness.load import KINDS

if TYPE_CHECKING:
    from collections.abc import Callable

    from rich.table import Table

    from rtctl.readiness.rounds import Step
    from rtctl.settings import Settings


def add_to(app: typer.Typer) -> None:
    """Add the command."""
    app.command(rich_help_panel=RUN)(certify)


def certify(
    config: CONFIG = DEFAULT_CONFIG,
    minutes: Annotated[
        float, typer.Option(help="Of the loop; cyclictest takes as long again.", min=0.05, max=20160.0)
    ] = 10.0,
    load: Annotated[
        str, typer.Option(help=f"What else the machine does, at normal priority: {', '.join(KINDS)}.")
    ] = "idle",
    rounds: Annotated[int, typer.Option(help="Loop and cyclictest take turns so often.", min=1, max=1000)] = 15,
    check: Annotated[
        Path | None,
        typer.Option(
            help="Measure nothing: is this certificate whole, and does it fit this machine and these settings?"
        ),
    ] = None,
    overrides: SET = None,
    json: JSON = False,
) -> int:
    """Measure how the loop keeps time, in turn with cyclictest, and write a certificate: JSON and a page.

    The real-time process runs without a network, a simulated robot moving, hardware without power. Certificates are
    kept in `certificates` beside the runs (log.directory); every log names the newest one that fits. Ctrl-C leaves an
    incomplete one of the rounds that were measured.

    Exit code 0 if every promise was kept, 1 if one was not or could not be told, 6 if a certificate is no good or
    belongs elsewhere.

    Example: `rtctl certify planar-sim --minutes 10 --load cpu`
    """  # fmt: skip
    from rtctl.settings import load as load_settings

    settings = load_settings(config, overrides or ())
    if check is not None:
        return _check(check, settings, json)
    if load not in KINDS:
        raise typer.BadParameter(f"{load!r} is none of {', '.join(KINDS)}", param_hint="--load")
    return _measure(settings, 60.0 * minutes, rounds, load, json)


def _measure(settings: "Settings", seconds: float, rounds: int, load: str, json: bool) -> int:
    import signal

    from rtctl.readiness.certificate import folder_of, write
    from rtctl.readiness.certify import certify as measure
    from rtctl.readiness.rounds import Plan
    from rtctl.report.certificate import page

    plan = Plan(seconds, rounds, load)
    signal.signal(signal.SIGTERM, signal.default_int_handler)  # what has been measured is kept then, too
    with _shown() as tell:
        document = measure(settings, plan, tell)
    path = write(document, folder_of(settings))
    path.with_suffix(".html").write_text(page(document), encoding="utf-8")
    _tell(document, path, json)
    if not document["complete"]:
        say_error(f"interrupted after {document['rounds']} of {document['rounds_asked']} rounds")
        return Exit.INTERRUPTED
    return _code(document)


def _check(path: Path, settings: "Settings", json: bool) -> int:
    from rtctl.readiness.certificate import misfits, read

    document = read(path)
    found = misfits(document, settings)
    _tell(document, path, json)
    for line in found:
        say_error(line)
    if found:
        return Exit.DATA
    remark("it is as it was written, and fits this machine and these settings")
    return _code(document)


def _code(document: dict[str, Any]) -> int:
    from rtctl.readiness.verdicts import KEPT

    return Exit.OK if document["verdict"] == KEPT else Exit.FAILED


def _tell(document: dict[str, Any], path: Path, json: bool) -> None:
    import json as encoder

    if json:
        say(encoder.dumps(document, indent=1, ensure_ascii=False))
        return
    output().print(_table(document))
    if document["reference"]["obstacle"]:
        say(f"no reference, so no ratio: {document['reference']['obstacle']}")
    state = "" if document["complete"] else ", incomplete"
    say(f"promises {document['verdict']}{state}; load: {document['load']['what']}; grade {document['loop']['grade']}")
    say(f"{path}, sha256 {document['sha256']}")
    page = path.with_suffix(".html")
    if page.exists():
        say(f"page: {page}")


def _table(document: dict[str, Any]) -> "Table":
    from rich.table import Table

    table = Table(title=f"certificate of robot {document['robot']}, {document['begun']}", title_justify="left")
    for head in ("promise", "bound", "measured", "kept"):
        table.add_column(head, justify="left" if head == "promise" else "right")
    words = {True: "yes", False: "NO", None: "not known"}
    for v in document["verdicts"]:
        measured = v["measured"]
        text = "–" if measured is None else f"{measured:.4g}" if isinstance(measured, float) else str(measured)
        table.add_row(v["name"], f"{v['bound']} {v['unit']}", text, words[v["kept"]])
    return table


@contextmanager
def _shown() -> "Iterator[Callable[[Step], None]]":
    """Progress: a bar on a terminal, one line a round anywhere else."""
    if not side().is_terminal:
        yield lambda step: remark(f"{step.done_s:7.0f} of {step.total_s:.0f} s measured; round {step.round}: {step.what}")  # fmt: skip
        return
    from rich.progress import BarColumn, Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

    columns = SpinnerColumn(), TextColumn("{task.description}"), BarColumn(), TextColumn("{task.completed:.0f} of {task.total:.0f} s"), TimeElapsedColumn()  # fmt: skip
    with Progress(*columns, console=side()) as bars:
        task = bars.add_task("looking at the machine", total=None)
        yield lambda step: bars.update(task, description=f"round {step.round}: {step.what}", completed=step.done_s, total=step.total_s)  # fmt: skip
