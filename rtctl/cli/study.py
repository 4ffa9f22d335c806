"""``rtctl study``: experiments of the sources, repeated on the simulated bench."""

from pathlib import Path
from typing import Annotated

import typer

from rtctl.cli.console import remark, say
from rtctl.cli.exit_codes import Exit

study = typer.Typer(no_args_is_help=True)


def add_to(app: typer.Typer) -> None:
    """Register the group."""
    app.add_typer(study, name="study", help="Experiments of the sources, repeated on the simulated bench.")


@study.callback()
def _group() -> None:
    """Experiments of the sources, repeated on the simulated bench."""


@study.command()
def admittance(
    to: Annotated[Path, typer.Option(help="Folder for table, rows and figures; it is made.")] = Path(
        "study-admittance"
    ),
    jobs: Annotated[int | None, typer.Option(min=1, help="Processes; all cores if not given.")] = None,
    seed: Annotated[int, typer.Option(min=0, help="First seed.")] = 0,
) -> Exit:
    """Sets 0 to 5 of the force-control study, Table VI.3 and Figures VI.4 to VI.6: some two minutes on two cores.

    Example: `rtctl study admittance --to force-control`
    """
    import os

    from hal.errors import OptionError
    from rtctl.cli.campaign import Pace, shown
    from rtctl.report.style import svg
    from rtctl.study import admittance as sets
    from rtctl.study import admittance_figures as figures

    if to.exists() and not to.is_dir():
        raise OptionError("--to is not a folder", value=str(to), remedy="name another one")
    todo = sets.cases(seed)
    with shown(Pace()) as report:
        found = sets.run(todo, jobs or os.cpu_count() or 1, report)
    text = sets.table(todo, found)
    to.mkdir(parents=True, exist_ok=True)
    (to / "table.md").write_text(text)
    sets.write_rows(to / "insertions.csv", todo, found)
    for specimen in sorted({case.set.specimen for case in todo}):
        (to / f"mean-force-{specimen}.svg").write_text(svg(figures.mean_forces(todo, found, specimen)))
    (to / "corrections.svg").write_text(svg(figures.corrections(todo, found)))
    say(text)
    remark(f"table, rows and figures are in {to}")
    return Exit.OK
