"""The rest of an insertion's forces from its beginning (Algorithm 1 in its consistent form, 03 section 2; D V.12 to V.21).

:func:`predict` is the definition: a weighted fit of everything at once. The tick follows it sample by sample with
:func:`know` and :func:`forecast`, from tables made beforehand by :func:`tabulate`. That is possible because of what the
fit weighs only the number of known samples decides, never their values. So the factor of the normal equations is a table,
known forces are a sum that grows, and the part of the future depends on the last force alone.
"""

import math

import numpy as np

from hal.kernel import kernel
from rtctl.guidance.force_model import ORDER, ForceModel, basis, basis_derivative

LENGTH = 0.2
"""l: over this share of the depth forces of one insertion stay related [lambda]; not printed in the sources."""
TERMS = ORDER + 1
PACKED = TERMS * (TERMS + 1) // 2
"""Numbers of a lower triangle."""


def rate_deviation(model: ForceModel, x: np.ndarray) -> np.ndarray:
    """sigma_d = sqrt(sigma_m'^2 + sigma_m^2 / l^2): deviation of df/dlambda over insertions, (channels, k) at `x` (k,)."""
    return np.hypot(model.deviation @ basis_derivative(x).T, model.deviation @ basis(x).T / LENGTH)


def fuse(model: ForceModel, x: np.ndarray, known: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Expected forces after the known samples (..., channels, m - k) and their standard deviation (channels, m - k).

    The mean of normal insertions and the extrapolation from the last known force, each as far as it can be trusted.

    Args:
        x: lambda (m,) of all samples, increasing.
        known: forces (..., channels, k) of the first k samples of any number of insertions, 1 <= k < m.
    """
    k = known.shape[-1]
    ahead = x[k:] - x[k - 1]
    slope = model.mean @ basis_derivative(x[k - 1 : k]).T
    mean, deviation = model.mean @ basis(x[k:]).T, _floored(model, x[k:])
    extrapolated, doubt = known[..., -1:] + slope * ahead, rate_deviation(model, x[k - 1 : k]) * ahead
    variance = deviation**2 + doubt**2
    return (mean * doubt**2 + extrapolated * deviation**2) / variance, deviation * doubt / np.sqrt(variance)


def predict(model: ForceModel, x: np.ndarray, known: np.ndarray) -> np.ndarray:
    """Bernstein coefficients (..., channels, 11) of the forces of insertions of which the first samples are known.

    Arguments as of :func:`fuse`; k = m is the plain fit.
    """
    forces, deviation = known, np.broadcast_to(model.floor[:, None], known.shape[-2:])
    if known.shape[-1] < len(x):
        expected, uncertain = fuse(model, x, known)
        forces = np.concatenate([known, expected], axis=-1)
        deviation = np.hstack([deviation, uncertain])
    coefficients = np.empty((*known.shape[:-1], TERMS))
    for c, d in enumerate(deviation):
        weighted = (forces[..., c, :] / d).reshape(-1, len(x)).T
        fitted = (np.linalg.pinv(basis(x) / d[:, None]) @ weighted).T
        coefficients[..., c, :] = fitted.reshape(*known.shape[:-2], TERMS)
    return coefficients


def tables_dtype(samples: int, channels: int) -> np.dtype:
    """What :func:`forecast` needs, for every number of known samples from 1 on (first index, less one).

    factor: lower Cholesky factors of B^T W^-1 B, rows one after the other. prior, step: right-hand sides, to which a known
    force adds `basis` by its weight, and the last one `step` by its value. All in the basis of `basis` (samples, 11).
    """
    return np.dtype(
        [
            ("basis", "f8", (samples, TERMS)),
            ("known_weight", "f8", (channels,)),
            ("factor", "f8", (samples, channels, PACKED)),
            ("prior", "f8", (samples, channels, TERMS)),
            ("step", "f8", (samples, channels, TERMS)),
        ],
        align=True,
    )


def sums_dtype(channels: int) -> np.dtype:
    """What is known of the insertion under way: sum of basis by force and weight, last force, and the latest result."""
    return np.dtype(
        [
            ("sums", "f8", (channels, TERMS)),
            ("last", "f8", (channels,)),
            ("coefficient", "f8", (channels, TERMS)),
        ],
        align=True,
    )


def tabulate(model: ForceModel, x: np.ndarray) -> np.ndarray:
    """Tables (1,) of :func:`tables_dtype` for samples at `x` (m,), m > 10.

    The polynomials are taken in a basis that is orthonormal on the samples: the same functions as Bernstein's, without the
    digits that normal equations of those would lose. 1 / sigma^2 is the sum 1 / sigma_m^2 + 1 / sigma_e^2, so that the
    expected forces fall into the mean, the last force, and the slope of the mean.
    """
    samples, channels = len(x), len(model.mean)
    tables: np.ndarray = np.zeros(1, tables_dtype(samples, channels))
    t = tables[0]
    rows, _ = np.linalg.qr(basis(x))
    t["basis"] = rows
    t["known_weight"] = model.floor**-2.0
    mean, deviation = model.mean @ basis(x).T, _floored(model, x)
    slope, rate = model.mean @ basis_derivative(x).T, rate_deviation(model, x)
    triangle = np.tril_indices(TERMS)
    for k in range(1, samples + 1):
        ahead, future = x[k:] - x[k - 1], rows[k:]
        for c in range(channels):
            trust, mean_trust = (rate[c, k - 1] * ahead) ** -2.0, deviation[c, k:] ** -2.0
            weight = np.concatenate([np.full(k, t["known_weight"][c]), trust + mean_trust])
            upper = np.linalg.qr(rows * np.sqrt(weight)[:, None], mode="r")
            lower = (upper * np.sign(np.diag(upper))[:, None]).T
            t["factor"][k - 1, c] = lower[triangle]
            t["prior"][k - 1, c] = future.T @ (mean[c, k:] * mean_trust + slope[c, k - 1] * ahead * trust)
            t["step"][k - 1, c] = future.T @ trust
    return tables


@kernel
def know(tables, sums, sample, channel, force):
    """One more known force: `sample` is its number from 0 on, each in its turn."""
    sums.last[channel] = force
    for i in range(TERMS):
        sums.sums[channel, i] += tables.basis[sample, i] * force * tables.known_weight[channel]


@kernel
def forecast(tables, sums, known, channel):
    """Coefficients of the fit with the first `known` >= 1 samples: the normal equations by their factor, at fixed cost."""
    lower, c = tables.factor[known - 1, channel], sums.coefficient[channel]
    last = sums.last[channel]
    at = 0
    for i in range(TERMS):
        rest = sums.sums[channel, i] + tables.prior[known - 1, channel, i] + last * tables.step[known - 1, channel, i]
        for j in range(i):
            rest -= lower[at + j] * c[j]
        c[i] = rest / lower[at + i]
        at += i + 1
    for i in range(TERMS - 1, -1, -1):
        at = i * (i + 1) // 2
        c[i] /= lower[at + i]
        for j in range(i):
            c[j] -= lower[at + j] * c[i]


@kernel
def evaluate(tables, sums, sample, channel):
    """Force [N, N mm] of the latest fit at a sample."""
    force = 0.0
    for i in range(TERMS):
        force += tables.basis[sample, i] * sums.coefficient[channel, i]
    return force


@kernel
def start(sums):
    """Nothing is known, and nothing predicted."""
    sums.sums[:] = 0.0
    sums.last[:] = math.nan
    sums.coefficient[:] = math.nan


def _floored(model: ForceModel, x: np.ndarray) -> np.ndarray:
    """sigma_m, at least beta: (channels, k) at `x` (k,)."""
    return np.maximum(model.deviation @ basis(x).T, model.floor[:, None])
