"""Calibrate the planner's array model on the free shapes of the plant's array, as a laboratory does from photographs.

    python -m studies.free_shapes

prints the modal matrix that `config/planar-sim.toml` holds, and how well a matrix can describe the array at all.
"""

import sys

import numpy as np

from rtctl.electrode.calibration import calibrate
from rtctl.electrode.synthetic_arrays import S_SAMPLES_MM, STYLET_SAMPLES_MM
from sim_backends.plant.options import Array
from sim_backends.plant.rod.state import array_bending, rest_curvature

FINE_MM = 0.01


def free_angles(array: Array, s_mm: np.ndarray, stylet_mm: np.ndarray) -> np.ndarray:
    """Bending angles (w, z) [rad] of the free array at arc lengths (w,) and stylet withdrawals (z,), by quadrature."""
    s = np.arange(0.0, array.length_mm + FINE_MM / 2, FINE_MM)
    from_tip = array.length_mm - s
    bending, rest = array_bending(array, from_tip), rest_curvature(array, from_tip)
    columns = []
    for withdrawal in stylet_mm:
        place = np.clip((from_tip - array.soft_tip_mm - withdrawal) / array.stylet_blend_mm + 0.5, 0.0, 1.0)
        wire = array.stylet_bending_nmm2 * place**2 * (3.0 - 2.0 * place)
        curvature = bending * rest / (bending + wire)
        turned = np.append(0.0, np.cumsum((curvature[1:] + curvature[:-1]) / 2 * FINE_MM))
        columns.append(np.interp(s_mm, s, turned))
    return np.stack(columns, axis=1)


def modal_model(array: Array) -> tuple[np.ndarray, float]:
    """Modal matrix (4, 4) of the array (02 section 3), and the rms residual of its angles [rad]."""
    angles = free_angles(array, S_SAMPLES_MM, STYLET_SAMPLES_MM)
    matrix = calibrate(S_SAMPLES_MM, STYLET_SAMPLES_MM, angles)
    fitted = np.vander(S_SAMPLES_MM, 4, increasing=True) @ matrix @ np.vander(STYLET_SAMPLES_MM, 4, increasing=True).T
    return matrix, float(np.sqrt(np.mean((fitted - angles) ** 2)))


def main() -> int:
    """Print the matrix and its residual."""
    matrix, residual = modal_model(Array())
    print("modal_matrix = [")
    for row in matrix:
        print("  [" + ", ".join(f"{value:.10e}" for value in row) + "],")
    print(
        f"]\nresidual: {residual:.4f} rad rms, over {S_SAMPLES_MM.size} arc lengths and {STYLET_SAMPLES_MM.size} withdrawals"
    )
    return 0


if __name__ == "__main__":
    sys.exit(main())
