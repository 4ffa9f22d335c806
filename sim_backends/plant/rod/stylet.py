"""The stylet: where it is, it stiffens the array and straightens it; bent too far, either stays bent (08 section 3)."""

import math

from hal.kernel import kernel


@kernel
def occupied(rod, from_tip_mm, stylet_mm):
    """Share of the stylet's stiffness that is felt at a distance from the tip; it ends smoothly."""
    place = (from_tip_mm - rod.soft_tip_mm - stylet_mm) / rod.blend_mm + 0.5
    if place <= 0.0:
        return 0.0
    if place >= 1.0:
        return 1.0
    return place * place * (3.0 - 2.0 * place)


@kernel
def set_stylet(rod, stylet_mm):
    """Stiffness and rest angle of every joint with the stylet withdrawn by `stylet_mm`.

    Array and stylet are bent together: B = B_a + B_s and B kappa_0 = B_a kappa_a + B_s kappa_s, where kappa_s is what
    stayed of an earlier bend of the stylet.
    """
    rod.stylet_mm = stylet_mm
    n, edge = rod.segments, rod.edge_mm
    for i in range(1, n):
        wire = rod.stylet_nmm2 * occupied(rod, (n - i) * edge, stylet_mm)
        total = rod.array_nmm2[i] + wire
        moment = rod.array_nmm2[i] * (rod.rest_per_mm[i] + rod.array_set_per_mm[i]) + wire * rod.stylet_set_per_mm[i]
        rod.bending_nmm2[i] = total
        rod.rest_turn_rad[i] = edge * moment / total


@kernel
def remember(rod):
    """Plastic set of both materials: what is bent beyond its yield curvature keeps the rest. True if anything did."""
    changed = False
    n, edge = rod.segments, rod.edge_mm
    per_edge, array_yield, stylet_yield = 1.0 / edge, rod.array_yield_per_mm, rod.stylet_yield_per_mm
    for i in range(1, n):
        bent = rod.turn_rad[i] * per_edge
        over = bent - rod.rest_per_mm[i] - rod.array_set_per_mm[i]
        if abs(over) > array_yield:
            rod.array_set_per_mm[i] += over - math.copysign(array_yield, over)
            rod.set_per_mm = max(rod.set_per_mm, abs(rod.array_set_per_mm[i]))
            changed = True
        over = bent - rod.stylet_set_per_mm[i]
        if abs(over) > stylet_yield and occupied(rod, (n - i) * edge, rod.stylet_mm) > 0.5:
            rod.stylet_set_per_mm[i] += over - math.copysign(stylet_yield, over)
            rod.set_per_mm = max(rod.set_per_mm, abs(rod.stylet_set_per_mm[i]))
            changed = True
    return changed
