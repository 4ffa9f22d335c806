"""The manufacturer's calibration file of a force/torque transducer, both generations (07 sections 3.1, 3.2).

Everything becomes N, N mm and mm while it is read; what is not understood is refused, never guessed.
"""

import hashlib
import math
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NoReturn
from xml.etree.ElementTree import Element, TreeBuilder
from xml.parsers import expat

import numpy as np

from drivers.ati.mounting import frame_change
from hal.errors import OptionError

AXES = ("Fx", "Fy", "Fz", "Tx", "Ty", "Tz")
GAUGES = 6
LARGEST_BYTES = 1_000_000
AGREEMENT = 1e-4
"""Axis and UserAxis must give the same matrix to this share of its largest entry, row by row."""
WORST_CONDITION = 1e3
"""A transducer's is near 13, in rated loads (07 section 3.3)."""

N_PER_LB = 4.44822161526
NMM_PER_LB_IN = 112.984829028
FORCE_N = {"N": 1.0, "kN": 1000.0, "lb": N_PER_LB, "lbf": N_PER_LB, "klb": 1000.0 * N_PER_LB}
TORQUE_NMM = {"N-mm": 1.0, "Nmm": 1.0, "N-m": 1000.0, "Nm": 1000.0, "lb-in": NMM_PER_LB_IN, "lbf-in": NMM_PER_LB_IN, "lb-ft": 12.0 * NMM_PER_LB_IN, "lbf-ft": 12.0 * NMM_PER_LB_IN}  # fmt: skip
DISTANCE_MM = {"mm": 1.0, "cm": 10.0, "m": 1000.0, "in": 25.4, "ft": 304.8}
ANGLE_RAD = {"degrees": math.pi / 180.0, "deg": math.pi / 180.0, "radians": 1.0, "rad": 1.0}
NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?")


@dataclass(frozen=True)
class Calibration:
    """What the file says.

    Attributes:
        serial, body, part, date: of the transducer and its calibration. digest: start of the file's SHA-256.
        matrix (6, 6): wrench [N, N mm] for a volt of each gauge, in the frame the file's user axes have.
        rated (6,): largest loads of the axes [N, N mm].
        bias_slope, gain_slope (6,), thermistor_v: temperature compensation by a seventh channel; None without.
    """

    serial: str
    body: str
    part: str
    date: str
    digest: str
    matrix: np.ndarray
    rated: np.ndarray
    bias_slope: np.ndarray | None = None
    gain_slope: np.ndarray | None = None
    thermistor_v: float | None = None

    @property
    def identity(self) -> str:
        """One line that tells this calibration from any other."""
        return f"{self.body} {self.serial}, {self.part} of {self.date}, file {self.digest}"


def load(path: Path, part: str = "") -> Calibration:
    """Read the calibration `part` (its PartNumber; "" if there is one only) of the file. Raises OptionError."""
    try:
        with path.open("rb") as file:
            data = file.read(LARGEST_BYTES + 1)
    except OSError as error:
        raise OptionError("the calibration file cannot be read", value=str(path), remedy=str(error.strerror)) from None
    return parse(data, part, path.name)


def parse(data: bytes, part: str = "", name: str = "calibration") -> Calibration:
    """Calibration from the bytes of a file; `name` is for messages. Raises OptionError."""
    return _Reader(name).read(data, part)


def _tree(data: bytes, name: str) -> Element:
    """The document, without any of XML's ways to grow: no document type, hence no entities of its own."""
    if len(data) > LARGEST_BYTES:
        raise OptionError(
            f"{name} is too large for a calibration file", value=len(data), bound=f"{LARGEST_BYTES} bytes"
        )
    builder, parser = TreeBuilder(), expat.ParserCreate()

    def refuse(*_: Any) -> NoReturn:
        raise OptionError(f"{name} declares a document type, which no calibration file does", remedy="get the original file")  # fmt: skip

    parser.StartDoctypeDeclHandler = refuse
    parser.StartElementHandler, parser.EndElementHandler = builder.start, builder.end
    try:
        parser.Parse(data, True)
    except expat.ExpatError as error:
        raise OptionError(f"{name} is not well-formed XML", value=str(error), remedy="copy the file anew, as it is") from None  # fmt: skip
    except (ValueError, LookupError) as error:  # an encoding that is not there
        raise OptionError(
            f"{name} cannot be decoded", value=str(error), remedy="copy the file anew, as it is"
        ) from None
    return builder.close()


class _Reader:
    def __init__(self, name: str) -> None:
        self._name = name

    def read(self, data: bytes, part: str) -> Calibration:
        root = _tree(data, self._name)
        if root.tag != "FTSensor":
            self._refuse("is no calibration file: its root", root.tag, "FTSensor")
        if self._text(root, "NumGages") != str(GAUGES):
            self._refuse("is for another number of gauges", root.get("NumGages"), str(GAUGES))
        c = self._choose(root, part)
        force, torque = self._unit(c, "ForceUnits", FORCE_N), self._unit(c, "TorqueUnits", TORQUE_NMM)
        units = np.array([force] * 3 + [torque] * 3)
        for key, wanted in (("OutputRange", 20.0), ("GainMultiplier", 1.0)):
            if c.get(key) is not None and self._number(c, key) != wanted:
                self._refuse(f"has an unusual {key}", c.get(key), f"{wanted:g}")
        if c.get("OutputBipolar", "True").lower() != "true":
            self._refuse("is for unipolar outputs", c.get("OutputBipolar"), "True")
        matrix = self._matrix(c, units)
        rated = self._rated(c, units)
        condition = np.linalg.cond(matrix / rated[:, None])
        if not condition < WORST_CONDITION:
            self._refuse(
                "has a matrix that is nearly singular: condition", float(condition), f"below {WORST_CONDITION:g}"
            )
        slopes, thermistor = self._compensation(c)
        return Calibration(
            self._text(root, "Serial"), root.get("BodyStyle", "?"), self._text(c, "PartNumber"), c.get("CalDate", "?"),
            hashlib.sha256(data).hexdigest()[:12], matrix, rated, slopes[0], slopes[1], thermistor,
        )  # fmt: skip

    def _choose(self, root: Element, part: str) -> Element:
        found = [c for c in root.findall("Calibration") if not part or c.get("PartNumber") == part]
        if len(found) != 1:
            have = " | ".join(c.get("PartNumber", "?") for c in root.findall("Calibration"))
            self._refuse("has several or no such calibrations; set part", part or None, have or "none at all")
        return found[0]

    def _matrix(self, c: Element, units: np.ndarray) -> np.ndarray:
        """UserAxis is ready for use; Axis has to be scaled and moved, and must come to the same."""
        user = self._axes(c, "UserAxis")
        axes = self._axes(c, "Axis")
        if not user and not axes:
            self._refuse("has no axes", None, "six elements Axis or UserAxis")
        given = np.array([self._values(a, "values") for a in user]) * units[:, None] if user else None
        if not axes:
            assert given is not None
            return given
        basic = np.array([self._values(a, "values") / self._positive(a, "scale") for a in axes]) * units[:, None]
        matrix = self._basic_transform(c) @ basic
        if given is None:
            return matrix
        off = abs(given - matrix).max(axis=1) / abs(given).max(axis=1)
        if not off.max() <= AGREEMENT:
            self._refuse("says different things by Axis and UserAxis: off by", float(off.max()), f"{AGREEMENT:g}")
        return given

    def _rated(self, c: Element, units: np.ndarray) -> np.ndarray:
        """Of the user axes if they say so, else of the axes."""
        axes = self._axes(c, "UserAxis")
        if not axes or any(a.get("max") is None for a in axes):
            axes = self._axes(c, "Axis")
        if not axes:
            self._refuse("does not say what loads the transducer is rated for", None, "max of six axes")
        return np.array([self._positive(a, "max") for a in axes]) * units

    def _basic_transform(self, c: Element) -> np.ndarray:
        found = c.find("BasicTransform")
        if found is None:
            return np.eye(6)
        mm, rad = self._unit(c, "DistUnits", DISTANCE_MM), self._unit(c, "AngleUnits", ANGLE_RAD, "degrees")
        place = [self._number(found, k) * mm for k in ("Dx", "Dy", "Dz")]
        return frame_change(place, [self._number(found, k) * rad for k in ("Rx", "Ry", "Rz")])

    def _compensation(self, c: Element) -> tuple[tuple[np.ndarray | None, np.ndarray | None], float | None]:
        """Slopes and thermistor; none if the electronics do it themselves."""
        if c.get("HWTempComp", "False").lower() == "true":
            return (None, None), None
        parts = [c.find(k) for k in ("BiasSlope", "GainSlope", "Thermistor")]
        bias, gain, thermistor = parts
        if bias is None and gain is None and thermistor is None:
            return (None, None), None
        if bias is None or gain is None or thermistor is None:
            self._refuse("has only a part of a temperature compensation", None, "BiasSlope, GainSlope and Thermistor")
        return (self._values(bias, "values"), self._values(gain, "values")), self._number(thermistor, "value")

    def _axes(self, c: Element, tag: str) -> list[Element]:
        found = c.findall(tag)
        names = tuple(a.get("Name") for a in found)
        if found and names != AXES:
            self._refuse(f"has other elements {tag}", " ".join(map(str, names)), " ".join(AXES))
        return found

    def _unit(self, c: Element, key: str, table: dict[str, float], default: str | None = None) -> float:
        text = c.get(key, default)
        if text not in table:
            self._refuse(f"has an unknown {key}", text, " | ".join(table))
        return table[text]

    def _values(self, element: Element, key: str) -> np.ndarray:
        words = self._text(element, key).split()
        if len(words) != GAUGES:
            self._refuse(f"has a wrong count of {element.tag} {element.get('Name', '')} {key}", len(words), str(GAUGES))
        return np.array([self._finite(w, f"{element.tag} {element.get('Name', '')} {key}") for w in words])

    def _positive(self, element: Element, key: str) -> float:
        number = self._number(element, key)
        if number <= 0.0:
            self._refuse(f"has a {element.tag} {key} that is not positive", number, "above 0")
        return number

    def _number(self, element: Element, key: str) -> float:
        return self._finite(self._text(element, key).strip(), f"{element.tag} {key}")

    def _finite(self, word: str, what: str) -> float:
        if not NUMBER.fullmatch(word) or not word.isascii() or not math.isfinite(number := float(word)):
            self._refuse(f"has no finite number in {what}", word, "digits with a decimal point")
        return number

    def _text(self, element: Element, key: str) -> str:
        text = element.get(key)
        if not text:
            self._refuse(f"misses {key} of {element.tag}", None, "the complete file of the manufacturer")
        return text

    def _refuse(self, what: str, value: Any, bound: str) -> NoReturn:
        raise OptionError(
            f"{self._name} {what}", value=value, bound=bound, remedy="use the transducer's own file, unedited"
        )
