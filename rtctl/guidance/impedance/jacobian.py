"""How the stylet changes the impedances, and the step that brings a lost one back (04 section 4; (VII.22) to (VII.32)).

The sign convention is that of the words of the dissertation: n_k = (-sin theta_k, cos theta_k) points towards the modiolus
for an array that curls with growing theta. Then pulling the stylet makes every area smaller and every impedance larger, J
is positive, and a drop of the impedance pulls the stylet.
"""

import math

from hal.kernel import kernel
from rtctl.electrode.array_shape import mode_slopes, modes, polynomial
from rtctl.guidance.impedance.power_law import area_of_impedance, impedance_slope

PANEL_MM = 1.5
"""Longest interval of one quadrature: three Gauss points integrate J_pqs between two contacts to below 1e-7."""
OUTER = 0.5 * math.sqrt(0.6)
GAUSS = ((0.5 - OUTER, 5.0 / 18.0), (0.5, 4.0 / 9.0), (0.5 + OUTER, 5.0 / 18.0))
"""Three-point Gauss-Legendre rule on [0, 1]: (node, weight)."""


@kernel
def approach_rates(modal_matrix, stylet_mm, place_mm, gain):
    """g_k = n_k . J_pqs(s_k) of every contact into `gain` (n,): by how much it nears the modiolus per mm of stylet.

    place_mm (n,): s of the contacts from the grip, the one at the tip first, descending. J_pqs is that of (II.8), not to
    the last digit but in a third of the time: the tick in which this happens shall not stand out.
    """
    mode, slope = modes(modal_matrix, stylet_mm), mode_slopes(modal_matrix, stylet_mm)
    s = dx = dy = 0.0
    for k in range(place_mm.shape[0] - 1, -1, -1):
        panels = max(1, math.ceil((place_mm[k] - s) / PANEL_MM))
        h = (place_mm[k] - s) / panels
        for _ in range(panels):
            for node, weight in GAUSS:
                theta = polynomial(mode, s + node * h)
                rate = h * weight * polynomial(slope, s + node * h)
                dx -= rate * math.sin(theta)
                dy += rate * math.cos(theta)
            s += h
        theta = polynomial(mode, s)
        gain[k] = math.cos(theta) * dy - math.sin(theta) * dx


@kernel
def area_rate(gain, pitch_mm, k, pair_step):
    """dA_k/dq_s = -(g_k + g_k') pitch / 2 [mm^2/mm], (VII.25) with n towards the modiolus."""
    return -0.5 * pitch_mm * (gain[k] + gain[k + pair_step])


@kernel
def impedance_rate(law, gain, z_ohm, k):
    """J_k = a b A_k^(b-1) dA_k/dq_s [ohm/mm], A_k from the sample z_k; (VII.28)."""
    area = area_of_impedance(z_ohm, law.factor_ohm, law.exponent, law.far_field_ohm, law.area_max_mm2)
    return impedance_slope(area, law.factor_ohm, law.exponent) * area_rate(gain, law.pitch_mm, k, law.pair_step)


@kernel
def stylet_step(law, gain, z_ohm, baseline_ohm, usable, gamma):
    """Step of the stylet and |J|: -gamma J^T (z_j - z_(j-1)) / J^T J, between 0 and the limit [mm]; (VII.30), (VII.32).

    z_ohm, baseline_ohm (n,): samples now and at the last evaluation. usable: pairs that count, as bits; of them only
    those that have a baseline. Without any the step is 0 and |J| is 0; the step is NaN if it cannot be computed.
    """
    along, squares = 0.0, 0.0
    for k in range(law.pairs):
        if (usable >> k) & 1 and math.isfinite(baseline_ohm[k]):
            rate = impedance_rate(law, gain, z_ohm[k], k)
            along += rate * (z_ohm[k] - baseline_ohm[k])
            squares += rate * rate
    if squares == 0.0:
        return 0.0, 0.0
    step = -gamma * along / squares
    if not math.isfinite(step):
        return math.nan, math.nan
    return min(max(step, 0.0), law.step_limit_mm), math.sqrt(squares)
