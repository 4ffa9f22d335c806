"""From digitised images to the modal matrix of an array, and how well it describes them (spec 02 section 3; II.3)."""

from dataclasses import dataclass

import numpy as np

from rtctl.electrode.calibration import calibrate_segments, segment_angles
from rtctl.electrode.digitised import Image, check_coverage


@dataclass(frozen=True)
class Calibration:
    """What came out.

    modal_matrix: A (4, 4).
    images: what it was fitted to.
    residual_rad: of the chords of every image, model less measured; one array (n - 1,) an image.
    """

    modal_matrix: np.ndarray
    images: tuple[Image, ...]
    residual_rad: tuple[np.ndarray, ...]

    @property
    def rms_rad(self) -> float:
        """Root mean square residual over all chords."""
        return _rms(np.concatenate(self.residual_rad))

    @property
    def image_rms_rad(self) -> np.ndarray:
        """Root mean square residual (m,) of every image."""
        return np.array([_rms(residual) for residual in self.residual_rad])


def calibrate_images(images: list[Image]) -> Calibration:
    """Fit the modal matrix to the chords of all images; the angle of a chord is the mean of theta over its arc.

    Raises:
        DigitisedError: the withdrawals do not cover the stylet's stroke.
        RtctlError: there are too few different ones.
    """
    check_coverage(images)
    arcs = [image.arc_mm for image in images]
    samples = [
        (arc[:-1], arc[1:], np.full(len(arc) - 1, image.stylet_mm), image.chord_angle_rad)
        for arc, image in zip(arcs, images, strict=True)
    ]
    matrix = calibrate_segments(*(np.concatenate(column) for column in zip(*samples, strict=True)))
    residuals = tuple(segment_angles(matrix, *places) - angle for *places, angle in samples)
    return Calibration(matrix, tuple(images), residuals)


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2)))
