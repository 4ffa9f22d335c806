"""Images of an array as a person digitises them: 24 markers along its edge, each clicked on with an error (II.3)."""

import numpy as np

from rtctl.electrode.array_shape import LENGTH_MM
from rtctl.electrode.synthetic_arrays import STYLET_SAMPLES_MM, SYNTHETIC_ARRAYS

MARKERS = 24
SPACING_SD_MM = 0.03
"""Slight variations in the spacing of the electrodes."""
CLICK_SD_MM = 0.005
"""Corners of electrodes can be found within 0.01 mm."""


def points_of(angle_rad, s_mm):
    """Positions (n, 2) at arc lengths s (n,) of the curve with the bending angle angle_rad(s), finely integrated."""
    fine = np.linspace(0.0, LENGTH_MM, 7201)
    angle = angle_rad(fine)
    steps = np.diff(fine)[:, None] * 0.5 * sum(np.stack((np.cos(a), np.sin(a)), 1) for a in (angle[1:], angle[:-1]))
    curve = np.vstack((np.zeros(2), np.cumsum(steps, axis=0)))
    return np.stack([np.interp(s_mm, fine, column) for column in curve.T], axis=1)


def markers(rng, spacing_sd_mm=SPACING_SD_MM):
    """Arc lengths of the markers of one array, the first at the grip, the last at the tip."""
    s = np.linspace(0.0, LENGTH_MM, MARKERS)
    s[1:-1] += rng.normal(0.0, spacing_sd_mm, MARKERS - 2)
    return s


def images_of(number, seed=0, *, click_sd_mm=CLICK_SD_MM, spacing_sd_mm=SPACING_SD_MM):
    """(name, withdrawal, points (24, 2)) of every image of synthetic array `number`, 1 to 7."""
    rng, array = np.random.default_rng(seed), SYNTHETIC_ARRAYS[number - 1]
    s = markers(rng, spacing_sd_mm)
    found = []
    for k, stylet in enumerate(STYLET_SAMPLES_MM):
        exact = points_of(lambda at, q=stylet: array.angle_rad(at, np.array([q]))[:, 0], s)
        found.append((f"{k + 1:02d}", float(stylet), exact + rng.normal(0.0, click_sd_mm, exact.shape)))
    return found


def csv_of(images, comments=()):
    """The file of digitised points."""
    lines = [*(f"# {comment}" for comment in comments), "image,stylet_mm,x_mm,y_mm"]
    lines += [f"{name},{stylet:g},{x:.3f},{y:.3f}" for name, stylet, points in images for x, y in points]
    return "\n".join(lines) + "\n"
