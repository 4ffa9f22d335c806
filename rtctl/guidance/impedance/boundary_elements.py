"""The Laplace equation inside a polygon by constant boundary elements (04 section 1; (VII.11) to (VII.16)).

On every element either the potential or the flux dphi/dn is given; the other one follows. Elements run counter-clockwise,
each from its node to the next one's, the last to the first's.
"""

from dataclasses import dataclass

import numpy as np
from scipy.linalg.lapack import dgesv

from hal.errors import RtctlError
from hal.kernel import kernel
from rtctl.guidance.impedance.influence import flux_influence, potential_influence


class BoundaryError(RtctlError):
    """A boundary on which the potential cannot be found."""


@dataclass(frozen=True)
class Boundary:
    """A closed polygon of m elements.

    node_mm: where each begins (m, 2). curve: number of the straight piece it belongs to (m,). has_potential: whether its
    potential is given (m,), else its flux. given: that potential [V], or flux [V/mm] (m,).
    """

    node_mm: np.ndarray
    curve: np.ndarray
    has_potential: np.ndarray
    given: np.ndarray


def polygon(corner_mm: np.ndarray, elements: np.ndarray, has_potential: np.ndarray, given: np.ndarray) -> Boundary:
    """Boundary whose side i goes from corner i (n, 2) to the next one in elements[i] equal pieces; all (n,)."""
    corners = np.asarray(corner_mm, dtype=float)
    following = np.roll(corners, -1, axis=0)
    node = [a + (b - a) * (np.arange(k) / k)[:, None] for a, b, k in zip(corners, following, elements, strict=True)]
    side = np.repeat(np.arange(len(corners)), elements)
    return Boundary(np.concatenate(node), side, np.asarray(has_potential)[side], np.asarray(given, dtype=float)[side])


def solve(boundary: Boundary) -> tuple[np.ndarray, np.ndarray]:
    """Potential [V] and flux [V/mm] of every element, both (m,).

    Raises:
        BoundaryError: the potential is given nowhere, so it is known but for a constant; or the polygon is degenerate.
    """
    if not boundary.has_potential.any():
        raise BoundaryError("a potential must be given somewhere", remedy="name a side that is at 0 V")
    m = len(boundary.given)
    matrix, right = np.empty((m, m), order="F"), np.empty(m)
    assemble(boundary.node_mm, boundary.curve, boundary.has_potential, boundary.given, matrix, right)
    *_, unknown, info = dgesv(matrix, right, overwrite_a=1, overwrite_b=1)
    if info != 0 or not np.isfinite(unknown).all():
        raise BoundaryError("the boundary has no area, or crosses itself", value=f"pivot {info}", bound="regular")
    potential = np.where(boundary.has_potential, boundary.given, unknown)
    flux = np.where(boundary.has_potential, unknown, boundary.given)
    return potential, flux


@kernel
def assemble(node_mm, curve, has_potential, given, matrix, right):
    """Matrix (m, m) and right side (m,) of (VII.16), every row an equation of one element's midpoint.

    sum_k (F_2 - delta/2) phi_k - F_1 p_k = 0. Where zero is given there is nothing to integrate, and elements of a straight
    piece do not see each other: both is most of the work.
    """
    m = given.shape[0]
    for j in range(m):
        right[j] = 0.0
    for k in range(m):
        x0, y0 = node_mm[k, 0], node_mm[k, 1]
        after = k + 1 if k + 1 < m else 0
        x1, y1 = node_mm[after, 0], node_mm[after, 1]
        for j in range(m):
            last = j + 1 if j + 1 < m else 0
            x, y = 0.5 * (node_mm[j, 0] + node_mm[last, 0]), 0.5 * (node_mm[j, 1] + node_mm[last, 1])
            through = -0.5 if j == k else 0.0
            if has_potential[k]:
                matrix[j, k] = -potential_influence(x0, y0, x1, y1, x, y)
                if given[k] != 0.0:
                    seen = flux_influence(x0, y0, x1, y1, x, y) if curve[j] != curve[k] else 0.0
                    right[j] -= (seen + through) * given[k]
            else:
                seen = flux_influence(x0, y0, x1, y1, x, y) if curve[j] != curve[k] else 0.0
                matrix[j, k] = seen + through
                if given[k] != 0.0:
                    right[j] += potential_influence(x0, y0, x1, y1, x, y) * given[k]
