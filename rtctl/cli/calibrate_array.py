"""``rtctl calibrate array`` and ``rtctl calibrate shape``: the model of an electrode array, measured or estimated."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from rtctl.cli.calibrated import TO, hash_of, keep_as
from rtctl.cli.console import grid, output, remark, say
from rtctl.cli.exit_codes import Exit

if TYPE_CHECKING:
    import numpy as np
    from rich.table import Table

    from rtctl.electrode.image_calibration import Calibration

SUSPICIOUS = 2.5
"""An image whose residual is so many times the median image's is worth a second look."""


def add_to(group: typer.Typer) -> None:
    """Add the commands."""
    group.command()(array)
    group.command()(shape)


def array(
    file: Annotated[Path, typer.Argument(help="CSV file of digitised points.", dir_okay=False)],
    to: TO = None,
    figure: Annotated[
        Path | None, typer.Option(help="Draw measured and fitted shapes, .svg or .png.", dir_okay=False)
    ] = None,
) -> int:
    """Fit the modal matrix of an array to points digitised from images of it. The result is a file of settings.

    Example: `rtctl calibrate array docs/examples/array.csv --figure shapes.svg`
    """
    from rtctl.electrode import digitised
    from rtctl.electrode.image_calibration import calibrate_images

    found = calibrate_images(digitised.read(file))
    chords = sum(len(residual) for residual in found.residual_rad)
    output().print(_residuals(found))
    say(f"residual {found.rms_rad:.4f} rad rms over {len(found.images)} images, {chords} chords")
    for name in _suspicious(found):
        remark(f"image {name} fits worse than the others: is its withdrawal right, and was it digitised well?")
    worst = max(zip(found.image_rms_rad, found.images, strict=True), key=lambda pair: pair[0])
    provenance = {
        "from": f"{file.name}, sha256 {hash_of(file)}, {len(found.images)} images, {chords} chords",
        "residual": f"{found.rms_rad:.5f} rad rms; worst image {worst[1].name}, {worst[0]:.5f} rad rms",
    }
    keep_as("array", file.stem, to, provenance, _table(found.modal_matrix))
    if figure is not None:
        from rtctl.report import shapes_view, style

        style.save(shapes_view.draw(found), figure)
        say(str(figure))
    return Exit.OK


def shape(
    point: Annotated[
        tuple[float, float],
        typer.Option(
            help="Point the array goes through, stylet in, in its own frame: origin at the grip's ribs, x along it [mm].",
            metavar="X Y",
        ),
    ],
    known: Annotated[
        list[Path] | None,
        typer.Option(
            help="Result of `calibrate array` for an array of its kind; repeat it. The synthetic ones by default.",
            dir_okay=False,
        ),
    ] = None,
    to: TO = None,
) -> int:
    """Estimate the modal matrix of an array that cannot be calibrated, from one point it goes through.

    Example: `rtctl calibrate shape --point 16.77 3.44`
    """
    from rtctl.electrode import synthetic_arrays
    from rtctl.electrode.estimation import estimate

    matrices = [_matrix_in(file) for file in known or ()]
    if not matrices:
        remark("no --known arrays: starting from the mean of the seven synthetic ones")
        matrices = [synthetic_arrays.modal_matrix(number) for number in range(1, 8)]
    found = estimate(point, matrices)
    output().print(
        grid(
            {
                "arc length of the point": f"{found.place_mm:.4f} mm",
                "difference to the mean shape": f"{found.rms_rad:.4f} rad rms, cost {found.cost_rad2:.6f} rad²",
            }
        )
    )
    origin = [f"{file.name}, sha256 {hash_of(file)}" for file in known or ()] or ["seven synthetic arrays"]
    provenance = {
        "estimated from the point": f"{point[0]!r}, {point[1]!r} mm in {{E}}, at arc length {found.place_mm:.4f} mm",
        "mean of": "; ".join(origin),
        "difference to the mean shape": f"{found.rms_rad:.5f} rad rms",
    }
    keep_as("shape", "shape", to, provenance, _table(found.modal_matrix))
    return Exit.OK


def _table(modal_matrix: "np.ndarray") -> dict[str, dict[str, Any]]:
    """The result as settings."""
    return {"electrode": {"modal_matrix": modal_matrix.tolist()}}


def _matrix_in(file: Path) -> "np.ndarray":
    """The modal matrix in a file of settings that has one."""
    import numpy as np

    from hal.errors import OptionError
    from hal.options import read
    from rtctl.settings import Electrode, read_toml

    table = read_toml(file).get("electrode", {})
    if "modal_matrix" not in table:
        raise OptionError(f"{file} has no electrode.modal_matrix", remedy="give a result of `rtctl calibrate array`")
    return np.array(read(Electrode, table, "electrode").modal_matrix)


def _suspicious(found: "Calibration") -> list[str]:
    import numpy as np

    rms = found.image_rms_rad
    return [i.name for i, r in zip(found.images, rms, strict=True) if r > SUSPICIOUS * float(np.median(rms))]


def _residuals(found: "Calibration") -> "Table":
    from rich.table import Table
    from rich.text import Text

    table = Table(box=None, pad_edge=False, header_style="dim")
    for head in ("image", "stylet [mm]", "points", "length [mm]", "residual [rad rms]"):
        table.add_column(Text(head), justify="left" if head == "image" else "right")
    for image, rms in zip(found.images, found.image_rms_rad, strict=True):
        table.add_row(
            image.name, f"{image.stylet_mm:g}", str(len(image.lines)), f"{image.arc_mm[-1]:.2f}", f"{rms:.4f}"
        )
    return table
