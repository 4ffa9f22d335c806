"""The power law between impedance and the area of fluid of a pair of contacts (04 section 3; (VII.2), (VII.19), (VII.27)).

z(A) = a A^b + c with A in mm^2 and z in ohm; a > 0, b < 0, and c is the far-field value.
"""

from hal.kernel import kernel

FACTOR_OHM, EXPONENT, FAR_FIELD_OHM = 83.2, -1.317, 1149.0
"""a, b, c of Table VII.4."""
AREA_MAX_MM2 = 0.8
"""Largest area there can be between array and modiolus in the scala tympani; larger ones cannot be told apart."""


@kernel
def impedance_of_area(area_mm2, factor_ohm, exponent, far_field_ohm):
    """z(A) [ohm], (VII.2)."""
    return factor_ohm * area_mm2**exponent + far_field_ohm


@kernel
def area_of_impedance(z_ohm, factor_ohm, exponent, far_field_ohm, area_max_mm2):
    """A = min(((z - c) / a)^(1/b), A_max) [mm^2], and A_max for z <= c; (VII.27) with its exponent put right."""
    if z_ohm <= far_field_ohm:
        return area_max_mm2
    return min(((z_ohm - far_field_ohm) / factor_ohm) ** (1.0 / exponent), area_max_mm2)


@kernel
def impedance_slope(area_mm2, factor_ohm, exponent):
    """dz/dA = a b A^(b-1) [ohm/mm^2], never positive."""
    return factor_ohm * exponent * area_mm2 ** (exponent - 1.0)
