"""Linear algebra of six equations in a twist (translation, rotation), in scalars: nothing stored, nothing allocated.

A row is the tuple of six numbers (u, w): u for the translation, w for the rotation. Symmetric 3 x 3 matrices are the
tuple of their upper triangle, row by row; others the tuple of all nine entries.
"""

from hal.kernel import kernel


@kernel
def determinant(a, b, c, d, e, f):
    """Of the matrix of six rows, by Laplace's expansion in u and w: no division, so right where it is zero."""
    odd = (
        _minors(a, b, d, c, e, f)
        + _minors(a, b, f, c, d, e)
        + _minors(a, c, e, b, d, f)
        + _minors(a, d, f, b, c, e)
    )  # fmt: skip
    even = (
        _minors(a, b, c, d, e, f)
        + _minors(a, b, e, c, d, f)
        + _minors(a, c, d, b, e, f)
        + _minors(a, c, f, b, d, e)
        + _minors(a, d, e, b, c, f)
        + _minors(a, e, f, b, c, d)
    )
    return even - odd


@kernel
def _minors(a, b, c, d, e, f):
    """The minors of the rows a, b, c and d, e, f, in both ways to share u and w between them."""
    return _minor_of_u(a, b, c) * _minor_of_w(d, e, f) - _minor_of_u(d, e, f) * _minor_of_w(a, b, c)


@kernel
def _minor_of_u(a, b, c):
    return (
        a[0] * (b[1] * c[2] - b[2] * c[1])
        + a[1] * (b[2] * c[0] - b[0] * c[2])
        + a[2] * (b[0] * c[1] - b[1] * c[0])
    )  # fmt: skip


@kernel
def _minor_of_w(a, b, c):
    return (
        a[3] * (b[4] * c[5] - b[5] * c[4])
        + a[4] * (b[5] * c[3] - b[3] * c[5])
        + a[5] * (b[3] * c[4] - b[4] * c[3])
    )  # fmt: skip


@kernel
def solve_by_blocks(a, c, d, f, m):
    """Translation and rotation, three each, of the symmetric equations [A C; C^T D] (translation, rotation) = (f, m).

    NaN or infinite where there is no solution.
    """
    inverted = _inverse_of_symmetric(a[0], a[1], a[2], a[3], a[4], a[5])
    # columns of A^-1 C and A^-1 f
    g1, g2, g3 = (
        _times(inverted, c[0], c[3], c[6]),
        _times(inverted, c[1], c[4], c[7]),
        _times(inverted, c[2], c[5], c[8]),
    )
    h = _times(inverted, f[0], f[1], f[2])
    # what is left for the rotation: (D - C^T A^-1 C) rotation = m - C^T A^-1 f
    left = _inverse_of_symmetric(
        d[0] - (c[0] * g1[0] + c[3] * g1[1] + c[6] * g1[2]),
        d[1] - (c[0] * g2[0] + c[3] * g2[1] + c[6] * g2[2]),
        d[2] - (c[0] * g3[0] + c[3] * g3[1] + c[6] * g3[2]),
        d[3] - (c[1] * g2[0] + c[4] * g2[1] + c[7] * g2[2]),
        d[4] - (c[1] * g3[0] + c[4] * g3[1] + c[7] * g3[2]),
        d[5] - (c[2] * g3[0] + c[5] * g3[1] + c[8] * g3[2]),
    )
    x, y, z = _times(
        left,
        m[0] - (c[0] * h[0] + c[3] * h[1] + c[6] * h[2]),
        m[1] - (c[1] * h[0] + c[4] * h[1] + c[7] * h[2]),
        m[2] - (c[2] * h[0] + c[5] * h[1] + c[8] * h[2]),
    )
    return (
        h[0] - (g1[0] * x + g2[0] * y + g3[0] * z),
        h[1] - (g1[1] * x + g2[1] * y + g3[1] * z),
        h[2] - (g1[2] * x + g2[2] * y + g3[2] * z),
        x,
        y,
        z,
    )


@kernel
def _inverse_of_symmetric(m11, m12, m13, m22, m23, m33):
    k11, k12, k13 = m22 * m33 - m23 * m23, m13 * m23 - m12 * m33, m12 * m23 - m13 * m22
    scale = 1.0 / (m11 * k11 + m12 * k12 + m13 * k13)
    k22, k23, k33 = m11 * m33 - m13 * m13, m12 * m13 - m11 * m23, m11 * m22 - m12 * m12
    return scale * k11, scale * k12, scale * k13, scale * k22, scale * k23, scale * k33


@kernel
def _times(m, x, y, z):
    return m[0] * x + m[1] * y + m[2] * z, m[1] * x + m[3] * y + m[4] * z, m[2] * x + m[4] * y + m[5] * z
