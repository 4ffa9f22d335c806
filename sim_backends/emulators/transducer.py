"""The inside of a force/torque sensor: what its electronics make of the wrench in {F} (07 section 3).

Written from the specification on its own, and the other way round than a driver needs it.
"""

import math
from collections.abc import Mapping
from typing import Any
from xml.etree import ElementTree

import numpy as np

from hal.files import find

NEWTONS = {"N": 1.0, "lb": 4.44822161526}
NEWTON_MM = {"N-mm": 1.0, "N-m": 1e3, "lb-in": 112.984829028}
MILLIMETRES = {"mm": 1.0, "m": 1e3, "in": 25.4}


def turn(angles_rad: Any) -> np.ndarray:
    """Columns are the new axes in the old frame after turning about x, the new y, and the new z."""
    result = np.eye(3)
    for axis, angle in enumerate(angles_rad):
        c, s = math.cos(angle), math.sin(angle)
        one = np.eye(3)
        i, j = (axis + 1) % 3, (axis + 2) % 3
        one[i, i], one[i, j], one[j, i], one[j, j] = c, -s, s, c
        result = result @ one
    return result


def moving(origin_mm: Any, angles_rad: Any) -> np.ndarray:
    """Matrix (6, 6) that takes a wrench [N, N mm] of a frame at `origin_mm`, turned by `angles_rad`, to the one it moved from."""
    axes, (x, y, z) = turn(angles_rad), origin_mm
    matrix = np.zeros((6, 6))
    matrix[:3, :3] = matrix[3:, 3:] = axes
    matrix[3:, :3] = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]]) @ axes
    return matrix


def out_of_f(table: Mapping[str, Any]) -> np.ndarray:
    """Matrix (6, 6) from a wrench in {F} to the sensor's own frame, from a device's settings of its mounting."""
    return moving(table.get("translation_mm", (0.0,) * 3), np.radians(table.get("rotation_deg", (0.0,) * 3)))


class Bridge:
    """Six strain gauges and their amplifier, from the calibration file that was made for them.

    Attributes:
        rated (6,): [N, N mm]. reference_v: T-out at which no compensation is needed, NaN if none ever is.
    """

    def __init__(self, path: str, part: str = "") -> None:
        root = ElementTree.fromstring(find(path).read_bytes())
        found = next(c for c in root.iter("Calibration") if part in ("", c.get("PartNumber")))
        units = [NEWTONS[found.attrib["ForceUnits"]]] * 3 + [NEWTON_MM[found.attrib["TorqueUnits"]]] * 3
        # Axis, where it is there, is closer to the gauges than what was derived from it
        axes = found.findall("Axis") or found.findall("UserAxis")
        rows = np.array([a.attrib["values"].split() for a in axes], float)
        rows *= (np.array(units) / [float(a.get("scale", 1.0)) for a in axes])[:, None]
        self.rated = np.array([float(a.attrib["max"]) for a in axes]) * units
        basic = found.find("BasicTransform")
        place = basic.attrib if basic is not None and found.findall("Axis") else {}
        mm = MILLIMETRES[found.get("DistUnits", "mm")]
        origin_mm = [float(place.get(k, 0.0)) * mm for k in ("Dx", "Dy", "Dz")]
        angles_rad = [math.radians(float(place.get(k, 0.0))) for k in ("Rx", "Ry", "Rz")]
        self._volts = np.linalg.inv(rows) @ moving(origin_mm, angles_rad)
        self.reference_v, self._bias_slope, self._gain_slope = math.nan, np.zeros(6), np.zeros(6)
        thermistor = found.find("Thermistor")
        if found.get("HWTempComp", "False") != "True" and thermistor is not None:
            self.reference_v = float(thermistor.attrib["value"])
            self._bias_slope, self._gain_slope = (
                np.array(found.find(k).attrib["values"].split(), float)  # type: ignore[union-attr]
                for k in ("BiasSlope", "GainSlope")
            )

    def gauge_v(self, wrench_in_sensor: np.ndarray, zero_v: np.ndarray, t_out_v: float) -> np.ndarray:
        """Voltages (6,) of the gauges; `zero_v` is what they show unloaded, at the reference temperature."""
        volts = self._volts @ wrench_in_sensor + zero_v
        if math.isnan(self.reference_v):
            return volts
        warmth_v = t_out_v - self.reference_v
        return volts * (1.0 - self._gain_slope * warmth_v) - self._bias_slope * warmth_v
