"""A rod alone: uniform, straight, and at rest under dead loads on its nodes. Only the public kernels are the plant's."""

import numpy as np

from hal.kernel import kernel
from sim_backends.plant.options import Array
from sim_backends.plant.rod.band import eliminate, substitute
from sim_backends.plant.rod.elastic import assemble
from sim_backends.plant.rod.state import ROD, pack
from sim_backends.plant.rod.step import place

LENGTH_MM = 16.0
STATIC_S = 1e9
"""A step so long that nothing is damped any more."""


@kernel
def _place(rod, pose):
    place(rod[0], pose, 0.0)


@kernel
def _turned(rod, load_n, hold_n_per_mm):
    """Pivots that are not positive, of energy less work of the dead loads, springs (n + 1, 2) to the frame included."""
    r = rod[0]
    n = r.segments
    assemble(r, STATIC_S)
    for i in range(n + 1):
        for c in range(2):
            row = 2 * (n - i) + c
            r.gradient[row] -= load_n[i, c]
            r.band[row, 0] += hold_n_per_mm[i, c]
    return eliminate(r.band, r.gradient, 2 * n - 2)


@kernel
def _relax(rod, load_n, hold_n_per_mm, iterations, tolerance_mm, reach_mm):
    """Newton's method to rest; the iterations it took."""
    r = rod[0]
    n = r.segments
    for k in range(iterations):
        _turned(rod, load_n, hold_n_per_mm)
        substitute(r.band, r.gradient, 2 * n - 2)
        largest = 0.0
        for row in range(2 * n - 2):
            largest = max(largest, abs(r.gradient[row]))
        scale = min(1.0, reach_mm / max(largest, 1e-300))
        for i in range(2, n + 1):
            for c in range(2):
                r.node_mm[i, c] -= scale * r.gradient[2 * (n - i) + c]
        if largest < tolerance_mm:
            return k
    return iterations


class BareRod:
    """A straight rod of free length `LENGTH_MM` along x from the origin, where it is clamped; hardly extensible."""

    def __init__(self, segments, bending_nmm2=1.0, axial_n=1e6):
        self.rod = np.zeros(1, ROD)
        self.record = r = self.rod[0]
        pack(Array(segments=segments, length_mm=LENGTH_MM, relaxation_s=0.0, grip_angle_rad=0.0), r)
        r["array_nmm2"], r["rest_per_mm"], r["stylet_nmm2"], r["drag_n_s_per_mm"] = bending_nmm2, 0.0, 0.0, 0.0
        r["stretch_n_per_mm"] = axial_n / r["edge_mm"]
        self.segments = segments
        self.load_n = np.zeros((segments + 1, 2))
        self.hold_n_per_mm = np.zeros((segments + 1, 2))
        _place(self.rod, np.zeros(3))

    @property
    def nodes_mm(self):
        return self.record["node_mm"][: self.segments + 1]

    def relax(self, iterations=500):
        """To rest under the loads; fails if it does not come to rest."""
        took = _relax(self.rod, self.load_n, self.hold_n_per_mm, iterations, 1e-10, 0.5)
        assert took < iterations

    def turned(self):
        """How many ways to buckle the rod has where it is."""
        return _turned(self.rod, self.load_n, self.hold_n_per_mm)
