"""``rtctl bench``: the drivers against emulated devices: the bench itself, a whole insertion on it, and its faults."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rtctl.cli import soak
from rtctl.cli.console import output, remark, say, say_error
from rtctl.cli.exit_codes import Exit
from rtctl.cli.options import RUN, SEED, SET

if TYPE_CHECKING:
    from rich.table import Table

    from rtctl.hil.comparison import Difference
    from rtctl.hil.faults import Outcome

HIL = "planar-hil"
CONFIG = Annotated[
    str, typer.Argument(help="Settings of a backend of hardware, or the name of a file that ships with rtctl.", metavar="[config]", show_default=True)
]  # fmt: skip


def add_to(app: typer.Typer) -> None:
    """Add the commands."""
    group = typer.Typer(help="Hardware in the loop: the drivers on emulated devices.", no_args_is_help=True)
    group.command()(rig)
    group.command()(hil)
    group.command()(faults)
    group.command()(soak.soak)
    app.add_typer(group, name="bench", rich_help_panel=RUN)


def rig(config: CONFIG = HIL, seed: SEED = 0, overrides: SET = None) -> int:
    """Keep the emulated devices alive, each in its process, until Ctrl-C: what `rtctl run` and its clients find there.

    Example: `rtctl bench rig planar-hil`
    """
    import signal
    import tempfile
    import time

    from rtctl.hil.processes import RigProcesses
    from rtctl.settings import load

    settings = load(config, overrides or ())
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    with tempfile.TemporaryDirectory() as folder:
        told = Path(folder) / "rig.txt"
        try:
            with RigProcesses(settings, seed, told) as bench:
                say(f"the emulated bench is up: {', '.join(bench.processes)}")
                while True:
                    time.sleep(0.5)
                    bench.check()
        except KeyboardInterrupt:
            return Exit.OK
        finally:
            if told.exists() and (text := told.read_text(errors="replace").strip()):
                remark(text)


def hil(
    config: CONFIG = HIL,
    seed: SEED = 0,
    overrides: SET = None,
    run_directory: Annotated[
        Path | None, typer.Option(help="Folder of this run; by default named by the time.")
    ] = None,
) -> int:
    """Do a whole insertion through the drivers, in real time, and compare it with the same one on the plant itself.

    The emulated devices, the real-time process and the gateway are processes of their own. Exit code 0 only if the
    insertion was completed and every signal is within its bound.

    Example: `rtctl bench hil planar-hil`
    """
    from rtctl.cli.insertion import insert_through_daemon
    from rtctl.cli.runs import new_directory
    from rtctl.hil.comparison import compare
    from rtctl.hil.insertion import on_the_plant
    from rtctl.hil.processes import RigProcesses
    from rtctl.recording import logs_in, open_recording
    from rtctl.settings import load

    settings = load(config, overrides or ())
    directory = run_directory or new_directory(settings.log.directory)
    directory.mkdir(parents=True, exist_ok=True)
    with RigProcesses(settings, seed, directory / "rig.txt") as bench:
        code, figures = insert_through_daemon(settings, config, overrides or [], seed, directory)
        bench.check()
    if code not in (Exit.OK, Exit.DATA) or figures is None:
        return code
    remark("the same insertion on the plant itself")
    found = compare(open_recording(logs_in(directory)).records, on_the_plant(settings, seed).records)
    output().print(_comparison(found))
    bad = [d.signal.name for d in found if not d.good]
    if bad:
        say_error(f"differs from the plant by more than it may: {', '.join(bad)}")
        return Exit.DATA
    return code


def _comparison(found: "list[Difference]") -> "Table":
    from rich.table import Table

    table = Table(title="through the drivers, less on the plant itself; at equal depth", title_justify="left")
    for head in ("signal", "rms", "largest", "rms may be", "unit", "within", "why so much"):
        table.add_column(head, justify="right" if head in ("rms", "largest", "rms may be") else "left")
    for d in found:
        s = d.signal
        table.add_row(
            s.name, f"{d.rms:.4g}", f"{d.largest:.4g}", f"{s.bound:g}", s.unit, "yes" if d.good else "NO", s.why
        )
    return table


def faults(config: CONFIG = HIL, overrides: SET = None) -> int:
    """Break every device in every way its emulator knows, in the middle of an insertion, and tell what came of it.

    In lockstep, so the latencies are exact. Exit code 6 if a fault was not seen.

    Example: `rtctl bench faults`
    """
    from rtctl.hil.faults import run
    from rtctl.settings import load

    settings = load(config, overrides or ())
    outcomes = []
    for outcome in run(settings):
        remark(f"{outcome.fault.what}: {outcome.text or 'nothing was told'}")
        outcomes.append(outcome)
    output().print(_outcomes(outcomes))
    return Exit.OK if all(o.seen_ticks is not None for o in outcomes) else Exit.DATA


def _outcomes(outcomes: "list[Outcome]") -> "Table":
    from rich.table import Table

    table = Table(title="faults in the middle of an insertion, in lockstep; a tick is 1 ms", title_justify="left")
    for head in ("what breaks", "seen by", "after", "state", "after", "goes on", "what the operator reads"):
        table.add_column(head, justify="right" if head == "after" else "left", overflow="fold")
    for o in outcomes:
        ticks = ["" if n is None else str(n) for n in (o.seen_ticks, o.reacted_ticks)]
        table.add_row(
            o.fault.what, o.sign or "nobody", ticks[0], o.state, ticks[1], "yes" if o.moving else "no", o.text
        )
    return table
