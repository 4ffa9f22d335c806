"""Points of an array, digitised from images: the CSV file, and arc lengths and angles from the points (II.3).

The file has one row a point, in order from the grip to the tip, image after image. Points, and not angles, because
points are what one clicks on: the file keeps the measurement, and how angles follow from it may still change.
"""

import csv
import io
import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from hal.errors import RtctlError
from rtctl.electrode.array_shape import LENGTH_MM, STYLET_MAX_MM

COLUMNS = {
    "image": ("", "name of the image, or its number; its rows are together"),
    "stylet_mm": ("mm", f"withdrawal of the stylet in it, 0 .. {STYLET_MAX_MM:g}; the same in all its rows"),
    "x_mm": ("mm", "along the array where it leaves the grip"),
    "y_mm": ("mm", "across it, towards the side to which the array curls"),
}
"""Column -> unit and meaning."""

LEAST_POINTS = 8
"""Of an image; with fewer the chords are so long that their angles say little of the curvature."""
LENGTH_TOLERANCE_MM = 1.0
"""How much the digitised length may differ from the array's: arrays vary, and the first point is at the grip's ribs."""
LARGEST_TURN_RAD = 0.5 * math.pi
"""From one chord to the next; more is a point out of order."""
FURTHEST_END_MM = 1.27
"""How far the withdrawals may stay from 0 and from 15 mm, a turn of the screw in (II.3): a cubic must not extrapolate."""


class DigitisedError(RtctlError):
    """A file of digitised points cannot be used; the message names the line."""

    exit_code = 2


@dataclass(frozen=True)
class Image:
    """One image.

    name: what the file calls it.
    stylet_mm: withdrawal in it.
    points_mm: points (n, 2), from the grip to the tip.
    lines: line of the file of every point (n,).
    """

    name: str
    stylet_mm: float
    points_mm: np.ndarray
    lines: tuple[int, ...]

    @property
    def chord_angle_rad(self) -> np.ndarray:
        """Angles (n - 1,) of the chords between the points, continuous along the array."""
        dx, dy = np.diff(self.points_mm, axis=0).T
        return np.unwrap(np.arctan2(dy, dx))

    @property
    def arc_mm(self) -> np.ndarray:
        """Arc lengths (n,) of the points, zero at the first.

        Each chord spans an arc that turns as its neighbours do, and is longer than the chord by (turn/2) / sin(turn/2):
        0.03 mm where an array of 1 mm radius is digitised every 0.8 mm.
        """
        chords = np.linalg.norm(np.diff(self.points_mm, axis=0), axis=1)
        middle = np.cumsum(chords) - chords / 2
        half_turn = np.gradient(self.chord_angle_rad, middle) * chords / 2
        return np.append(0.0, np.cumsum(chords / np.sinc(half_turn / np.pi)))


def read(path: Path) -> list[Image]:
    """The images of a file.

    Raises:
        DigitisedError: the file cannot be read, or is not what it should be; what, and in which line.
    """
    try:
        text = path.read_text(encoding="utf-8-sig")
    except OSError as error:
        raise DigitisedError("the points cannot be read", value=str(path), remedy=str(error.strerror)) from None
    except UnicodeDecodeError as error:
        raise DigitisedError(f"{path} is not text", value=str(error), remedy="save it as CSV in UTF-8") from None
    return parse(text)


def parse(text: str) -> list[Image]:
    """The images in the text of a file. Raises DigitisedError as :func:`read`."""
    groups = list(_grouped(_rows(text)))  # what is wrong with the order of the rows comes first
    images = [_image(name, rows) for name, rows in groups]
    if not images:
        raise DigitisedError("there is no point in the file", bound="a row a point", remedy=_columns())
    return images


def check_coverage(images: list[Image]) -> None:
    """Raises DigitisedError if the images do not reach from the stylet fully in to the stylet fully out."""
    stylet = [image.stylet_mm for image in images]
    for what, value, low, high in (
        ("smallest", min(stylet), 0.0, FURTHEST_END_MM),
        ("largest", max(stylet), STYLET_MAX_MM - FURTHEST_END_MM, STYLET_MAX_MM),
    ):
        if not low <= value <= high:
            raise DigitisedError(
                f"the {what} withdrawal is too far from the end: beyond it the model would be a guess",
                value=value,
                bound=f"{low:g} .. {high:g} mm",
                remedy="digitise an image there, too",
            )


def _rows(text: str) -> Iterator[tuple[int, str, list[float]]]:
    """(line, image, [stylet, x, y]) of every row; blank lines and those that begin with # are skipped."""
    columns: list[str] = []
    for number, line in enumerate(io.StringIO(text), start=1):
        if not line.strip() or line.lstrip().startswith("#"):
            continue
        cells = [cell.strip() for cell in next(csv.reader([line]))]
        if not columns:
            columns = _header(cells, number)
            continue
        if len(cells) != len(columns):
            remedy = "write numbers with a point, and a comma between columns"
            raise DigitisedError(
                f"line {number}: wrong number of columns", value=len(cells), bound=f"{len(columns)}", remedy=remedy
            )
        row = dict(zip(columns, cells, strict=True))
        if not row["image"]:
            raise DigitisedError(f"line {number}: the image has no name", remedy="name it, or number it")
        yield number, row["image"], [_number(row, name, number) for name in ("stylet_mm", "x_mm", "y_mm")]


def _header(cells: list[str], number: int) -> list[str]:
    for name in COLUMNS:
        if name not in cells:
            raise DigitisedError(f"line {number}: there is no column {name}", value=",".join(cells), remedy=_columns())
    for name in cells:
        if name not in COLUMNS or cells.count(name) > 1:
            raise DigitisedError(f"line {number}: a column is unknown or there twice", value=name, remedy=_columns())
    return cells


def _columns() -> str:
    return f"the first line must be {','.join(COLUMNS)}"


def _number(row: dict[str, str], name: str, number: int) -> float:
    try:
        value = float(row[name])
    except ValueError:
        remedy = "write it with a decimal point"
        raise DigitisedError(f"line {number}: {name} is not a number", value=row[name], remedy=remedy) from None
    if not math.isfinite(value):
        raise DigitisedError(
            f"line {number}: {name} is not finite", value=value, remedy="leave the image out, or digitise it again"
        )
    return value


def _grouped(rows: Iterator[tuple[int, str, list[float]]]) -> Iterator[tuple[str, list[tuple[int, list[float]]]]]:
    """(name, rows) of image after image."""
    done: set[str] = set()
    name, group = "", list[tuple[int, list[float]]]()
    for number, image, values in rows:
        if image != name:
            if group:
                yield name, group
            done.add(name)
            if image in done:
                remedy = "keep the rows of an image together, or give it another name"
                raise DigitisedError(f"line {number}: image {image} was there before", remedy=remedy)
            name, group = image, []
        group.append((number, values))
    if group:
        yield name, group


def _image(name: str, rows: list[tuple[int, list[float]]]) -> Image:
    stylet = rows[0][1][0]
    for number, values in rows:
        if values[0] != stylet:
            raise DigitisedError(
                f"line {number}: the withdrawal differs within image {name}",
                value=values[0],
                bound=f"{stylet:g} mm as before",
            )
        if not 0.0 <= stylet <= STYLET_MAX_MM:
            raise DigitisedError(
                f"line {number}: stylet_mm is out of bounds",
                value=stylet,
                bound=f"0 .. {STYLET_MAX_MM:g} mm",
                remedy="leave the image out: further out the stylet no longer changes the array",
            )
    image = Image(name, stylet, np.array([values[1:] for _, values in rows]), tuple(number for number, _ in rows))
    _check_points(image)
    return image


def _check_points(image: Image) -> None:
    where = f"line {image.lines[0]}: image {image.name}"
    if len(image.lines) < LEAST_POINTS:
        raise DigitisedError(
            f"{where} has too few points",
            value=len(image.lines),
            bound=f"at least {LEAST_POINTS}",
            remedy="digitise more of it",
        )
    chords = np.linalg.norm(np.diff(image.points_mm, axis=0), axis=1)
    if not chords.all():
        line = image.lines[int(np.argmin(chords)) + 1]
        raise DigitisedError(f"line {line}: the point is that of the line before", remedy="delete one of the two")
    angle = image.chord_angle_rad
    if abs(angle[0]) > LARGEST_TURN_RAD:
        raise DigitisedError(
            f"{where} does not begin along +x",
            value=round(float(angle[0]), 3),
            bound=f"within {LARGEST_TURN_RAD:.3g} rad",
            remedy="list the points from the grip to the tip, with x along the array where it leaves the grip",
        )
    turns = np.abs(np.diff(angle))
    if turns.max() > LARGEST_TURN_RAD:
        k = int(np.argmax(turns))
        raise DigitisedError(
            f"line {image.lines[k + 1]}: the array turns too far at this point",
            value=round(float(turns[k]), 3),
            bound=f"at most {LARGEST_TURN_RAD:.3g} rad from chord to chord",
            remedy="check the order of the points around it, or digitise them closer",
        )
    length = float(image.arc_mm[-1])
    if abs(length - LENGTH_MM) > LENGTH_TOLERANCE_MM:
        raise DigitisedError(
            f"{where} is of another length than the array",
            value=round(length, 3),
            bound=f"{LENGTH_MM - LENGTH_TOLERANCE_MM:g} .. {LENGTH_MM + LENGTH_TOLERANCE_MM:g} mm",
            remedy="check scale and unit, and that the points reach from the grip's ribs to the tip, in order",
        )
    if angle[-1] < -LARGEST_TURN_RAD:
        raise DigitisedError(
            f"{where} curls to the wrong side",
            value=round(float(angle[-1]), 3),
            bound="towards +y",
            remedy="change the sign of y: in most images it counts downwards",
        )
