"""``rtctl calibrate stiffness``: a tensile test of wire rope."""

from pathlib import Path
from typing import Annotated

import typer

from rtctl.cli.console import output
from rtctl.cli.exit_codes import Exit


def add_to(group: typer.Typer) -> None:
    """Add the command."""
    group.command()(stiffness)


def stiffness(
    file: Annotated[Path, typer.Argument(help="CSV file with the columns elongation_mm and tension_n.")],
    length: Annotated[float, typer.Option(help="Length of the specimen [mm].", min=1.0, max=10000.0)],
    points: Annotated[int, typer.Option(help="At how many elongations.", min=2, max=200)] = 11,
) -> int:
    """Tell the stiffness of a wire rope over its load, from a tensile test.

    Example: `rtctl calibrate stiffness rope-125.csv --length 125`
    """
    import numpy as np
    from rich.table import Table
    from rich.text import Text

    from rtctl.calibrate import table_file
    from rtctl.calibrate.errors import CalibrationError
    from rtctl.calibrate.wire_stiffness import axial_rigidity_n, local_stiffness

    samples, _ = table_file.read(file, ["elongation_mm", "tension_n"])
    if not len(samples):
        raise CalibrationError("there are no samples", value=str(file))
    elongation, tension = samples.T
    at = np.linspace(elongation.min(), elongation.max(), points)
    slope = local_stiffness(elongation, tension, at)
    order = np.argsort(elongation, kind="stable")
    load = np.interp(at, elongation[order], tension[order])
    table = Table(box=None, pad_edge=False)
    for heading in ("elongation [mm]", "tension [N]", "stiffness [N/mm]", "E A [N]"):
        table.add_column(Text(heading), justify="right")
    for row in zip(at, load, slope, axial_rigidity_n(slope, length), strict=True):
        table.add_row(*(f"{value:.{digits}f}" for value, digits in zip(row, (3, 1, 2, 0), strict=True)))
    output().print(table)
    return Exit.OK
