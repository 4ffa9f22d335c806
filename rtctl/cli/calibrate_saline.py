"""``rtctl calibrate saline``: what the leads of an array add to its impedances."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rtctl.cli.calibrated import TO, hash_of, keep
from rtctl.cli.console import output, remark
from rtctl.cli.exit_codes import Exit

if TYPE_CHECKING:
    from rich.table import Table

    from rtctl.guidance.impedance.saline import Bath


def add_to(group: typer.Typer) -> None:
    """Add the command."""
    group.command()(saline)


def saline(
    file: Annotated[Path, typer.Argument(help="MCAP log of a run with the array in a bath of saline.")],
    far_field: Annotated[
        float | None,
        typer.Option(help="What a pair shall read there [ohm]; c of the power law if absent.", min=0.0, max=10000.0),
    ] = None,
    to: TO = None,
) -> int:
    """Find the bias of every pair of contacts from an array in saline, clear of any wall. The result is a file of settings.

    Example: `rtctl calibrate saline runs/2026-01-31T10-00-00/log.mcap`
    """
    from rtctl.guidance.impedance import layout, saline
    from rtctl.recording import open_recording

    recording = open_recording([file])
    settings = recording.settings
    options = settings.impedance
    target_ohm = options.far_field_ohm if far_field is None else far_field
    pair, ohm = saline.samples_of(recording.records)
    bath = saline.calibrate(pair, ohm, options, layout.CONTACTS - options.pair_step, target_ohm)
    output().print(_figures(bath))
    for k in bath.left_out:
        remark(f"pair {k} is {bath.dead[k]}: it will never guide")
    provenance = {
        "from": f"{file}, {hash_of(file)}, {int(bath.samples.sum())} samples of {len(bath.samples)} pairs",
        "far field": f"{target_ohm:g} ohm",
        "noise": f"{bath.deviation_ohm[[not why for why in bath.dead]].max():.0f} ohm rms at most",
    }
    tables = {"impedance": {"bias_ohm": bath.bias_ohm.round(2).tolist(), "left_out": bath.left_out}}
    keep("saline", settings, to, provenance, tables)
    return Exit.OK


def _figures(bath: "Bath") -> "Table":
    from rich.table import Table
    from rich.text import Text

    table = Table(box=None, pad_edge=False)
    for heading in ("pair", "samples", "mean [ohm]", "rms [ohm]", "bias [ohm]"):
        table.add_column(Text(heading), justify="right")
    table.add_column("")
    rows = zip(bath.samples, bath.mean_ohm, bath.deviation_ohm, bath.bias_ohm, bath.dead, strict=True)
    for k, (count, mean, deviation, bias, why) in enumerate(rows):
        table.add_row(str(k), str(count), f"{mean:.0f}", f"{deviation:.0f}", "" if why else f"{bias:.0f}", why)
    return table
