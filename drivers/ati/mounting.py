"""How a sensor is mounted: wrenches from its own frame to {F} (07 section 3.2)."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from hal.options import option


def frame_change(translation_mm: Sequence[float], rotation_rad: Sequence[float]) -> np.ndarray:
    """Matrix (6, 6) that turns a wrench [N, N mm] in the old frame into the same wrench in a new one.

    Args:
        translation_mm (3,): origin of the new frame, in the old one.
        rotation_rad (3,): rotations that lead from the old axes to the new ones: about x, then the new y, then the new z.
    """
    (cx, cy, cz), (sx, sy, sz) = np.cos(rotation_rad), np.sin(rotation_rad)
    rotation = np.array(
        [
            [cy * cz, sx * sy * cz + cx * sz, sx * sz - cx * sy * cz],
            [-cy * sz, -sx * sy * sz + cx * cz, sx * cz + cx * sy * sz],
            [sy, -sx * cy, cx * cy],
        ]
    )
    x, y, z = translation_mm
    lever = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    change = np.zeros((6, 6))
    change[:3, :3] = change[3:, 3:] = rotation
    change[3:, :3] = -rotation @ lever
    return change


@dataclass(frozen=True, kw_only=True)
class Mounting:
    """Settings of every force sensor: where {F} is, seen from the sensor's own frame."""

    translation_mm: tuple[float, ...] = option(
        (0.0, 0.0, 0.0), shape=(3,), low=-1000, high=1000, unit="mm", doc="origin of {F} in the sensor's frame"
    )
    rotation_deg: tuple[float, ...] = option(
        (0.0, 0.0, 0.0), shape=(3,), low=-360, high=360, unit="deg",
        doc="from the sensor's axes to those of {F}: about x, then the new y, then the new z",
    )  # fmt: skip

    @property
    def into_f(self) -> np.ndarray:
        """Matrix (6, 6) from the sensor's frame to {F}."""
        return frame_change(self.translation_mm, np.radians(self.rotation_deg).tolist())
