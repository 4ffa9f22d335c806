"""The cochlear helix of CochleRob and the motion of the tip along it, tool axis along the tangent (01 section 3.6).

A helix of decreasing radius about a horizontal axis n; u [rad] is the angle about it. The tool axis A_0 z is sigma t with
the tangent t and its sign upwards, so that the slider never passes 90 deg. Wherever the tangent is horizontal the sign
changes, and the tip rests there while the arc makes half a turn. Everything here is prepared beside the loop.
"""

import itertools
import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from hal.errors import OptionError
from hal.options import option


@dataclass(frozen=True)
class Helix:
    """The curve p(u) = c + r(u) (cos a z + sin a n x z) + h u / u_end n in {B}; a = u + phase, r = r_0 exp(-k u)."""

    centre_mm: tuple[float, ...] = option(
        (60.0, 10.0, -10.0), shape=(3,), low=-1000, high=1000, unit="mm", doc="centre c of its base in {B}"
    )
    axis_azimuth_rad: float = option(
        math.radians(50), low=-6.3, high=6.3, unit="rad", doc="horizontal direction of its axis n, from x of {B} to y"
    )
    turns: float = option(2.5, low=0.1, high=10, doc="turns from base to apex")
    height_mm: float = option(4.0, low=0.1, high=100, unit="mm", doc="from base to apex along the axis, h")
    base_radius_mm: float = option(3.5, low=0.1, high=100, unit="mm", doc="radius at the base, r_0")
    apex_radius_mm: float = option(1.0, low=0.01, high=100, unit="mm", doc="radius at the apex")
    phase_rad: float = option(math.radians(30), low=-6.3, high=6.3, unit="rad", doc="a at the base, from z of {B}")

    def __post_init__(self) -> None:
        """Raises OptionError: it does not become narrower."""
        if self.apex_radius_mm >= self.base_radius_mm:
            bound = f"below {self.base_radius_mm:g} mm"
            what = "apex_radius_mm of a helix is not below base_radius_mm"
            raise OptionError(what, value=self.apex_radius_mm, bound=bound, remedy="set both")

    @property
    def end_rad(self) -> float:
        """u at the apex."""
        return 2.0 * math.pi * self.turns

    @property
    def decay(self) -> float:
        """k [1/rad]."""
        return math.log(self.base_radius_mm / self.apex_radius_mm) / self.end_rad

    @property
    def arc_length_mm(self) -> float:
        """Length of the curve: the integral of |p'| = sqrt(r^2 (1 + k^2) + (h / u_end)^2), in closed form."""
        k, rise = self.decay, self.height_mm / self.end_rad
        around = math.sqrt(1.0 + k * k) * np.array([self.base_radius_mm, self.apex_radius_mm])
        whole = np.hypot(around, rise) - rise * np.arcsinh(rise / around)
        return float(whole[0] - whole[1]) / k

    def derivatives(self, u: ArrayLike) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """p [mm], p' [mm/rad] and p'' [mm/rad2] at `u` (n,), each (n, 3) in {B}."""
        u, k = np.asarray(u, dtype=float), self.decay
        axis = np.array([math.cos(self.axis_azimuth_rad), math.sin(self.axis_azimuth_rad), 0.0])
        up = np.array([0.0, 0.0, 1.0])
        across = np.cross(axis, up)
        spiral = self.base_radius_mm * np.exp(
            (1j - k) * u + 1j * self.phase_rad
        )  # the plane (z, n x z) as complex numbers

        def in_base(complex_mm: np.ndarray, along_mm: np.ndarray) -> np.ndarray:
            return np.outer(complex_mm.real, up) + np.outer(complex_mm.imag, across) + np.outer(along_mm, axis)

        rise = np.full(u.shape, self.height_mm / self.end_rad)
        return (
            np.array(self.centre_mm) + in_base(spiral, rise * u),
            in_base((1j - k) * spiral, rise),
            in_base((1j - k) ** 2 * spiral, 0.0 * rise),
        )

    def half_turns_rad(self) -> np.ndarray:
        """Every u between base and apex at which the tangent is horizontal: there tan a = -k."""
        first = -math.atan(self.decay) - self.phase_rad
        steps = np.arange(math.ceil(-first / math.pi), math.ceil((self.end_rad - first) / math.pi))
        found = first + math.pi * steps
        return found[found > 0.0]


class Phase(NamedTuple):
    """One motion from rest to rest: along the helix from `u_from` to `u_to`, or half a turn of the arc at one u."""

    start_s: float
    duration_s: float
    u_from: float
    u_to: float
    sign: float
    """sigma."""
    phi_middle_rad: float
    """phi in the middle of the phase along the helix that this is, or that it follows."""
    turn_rad: float
    """0 or +-pi."""


class HelixMotion:
    """Pose of CochleRob against time on a helix, by a quintic law from rest to rest in every phase.

    Args:
        helix: the curve.
        turn_s: duration of one turn about the helix's axis.
        half_turn_s: duration of one half turn of the arc.

    Raises:
        OptionError: a duration that is not positive.
    """

    def __init__(self, helix: Helix, turn_s: float = 40.0, half_turn_s: float = 5.0) -> None:
        for name, duration in (("turn_s", turn_s), ("half_turn_s", half_turn_s)):
            if not 0.0 < duration < math.inf:
                raise OptionError(f"{name} of a helix is not a duration", value=duration, bound="above 0 s")
        self._helix = helix
        self.phases = self._plan(turn_s, half_turn_s)

    @property
    def duration_s(self) -> float:
        """From base to apex."""
        return self.phases[-1].start_s + self.phases[-1].duration_s

    def pose(self, time_s: ArrayLike) -> tuple[np.ndarray, np.ndarray]:
        """Poses (n, 5) [mm, rad] and their rates (n, 5) [mm/s, rad/s] at the times (n,); at rest before and after."""
        t = np.atleast_1d(np.asarray(time_s, dtype=float))
        table = np.array(self.phases)
        start, duration, u_from, u_to, sign, middle, turn = table[np.searchsorted(table[1:, 0], t, side="right")].T
        s = np.clip((t - start) / duration, 0.0, 1.0)
        done, rate = s**3 * (10.0 - 15.0 * s + 6.0 * s * s), 30.0 * (s * (1.0 - s)) ** 2 / duration

        u, u_rate = u_from + (u_to - u_from) * done, (u_to - u_from) * rate
        p, angles, p_per_u, angles_per_u = self._at(u, sign, middle)
        pose, pose_rate = np.hstack([p, angles]), u_rate[:, None] * np.hstack([p_per_u, angles_per_u])
        pose[:, 4] += turn * done
        pose_rate[:, 4] += turn * rate
        return pose, pose_rate

    def _at(self, u: np.ndarray, sign: ArrayLike, middle: ArrayLike) -> tuple[np.ndarray, ...]:
        """p (n, 3), (psi, phi) (n, 2), and both per u; phi is the one within half a turn of `middle`.

        It does not jump inside a phase: t has a constant sign along n, so that phi there spans less than half a turn.
        For the same reason the tangent is never vertical, where phi would not be defined.
        """
        p, first, second = self._helix.derivatives(u)
        speed = np.linalg.norm(first, axis=1)
        x, y, z = np.asarray(sign) * (first / speed[:, None]).T
        bend = second - first * (np.sum(first * second, axis=1) / speed**2)[:, None]
        dx, dy, dz = np.asarray(sign) * (bend / speed[:, None]).T
        flat = np.hypot(x, y)
        from_middle = np.arctan2(x, -y) - middle
        phi = middle + np.arctan2(np.sin(from_middle), np.cos(from_middle))
        angles = np.column_stack([np.arctan2(flat, z), phi])
        return p, angles, first, np.column_stack([-dz / flat, (x * dy - y * dx) / flat**2])

    def _plan(self, turn_s: float, half_turn_s: float) -> list[Phase]:
        """Of the two half turns the one is taken that keeps the mean of the next phase's first and last phi near 0."""
        ends = [0.0, *self._helix.half_turns_rad().tolist(), self._helix.end_rad]
        halves = np.array([math.pi, -math.pi])
        phases: list[Phase] = []
        now_s = phi_before = 0.0
        for u_from, u_to in itertools.pairwise(ends):
            u = np.array([0.5 * (u_from + u_to), u_from, u_to])
            sign = float(np.sign(self._helix.derivatives(u)[1][0, 2]))
            middle = float(self._at(u[:1], sign, 0.0)[1][0, 1])
            _, phi_first, phi_last = self._at(u, sign, middle)[1][:, 1].tolist()
            if phases:
                shifts = phi_before + halves - phi_first
                nearest = int(np.argmin(np.abs(0.5 * (phi_first + phi_last) + shifts)))
                _, _, _, u_before, sign_before, middle_before, _ = phases[-1]
                phases.append(
                    Phase(now_s, half_turn_s, u_before, u_before, sign_before, middle_before, float(halves[nearest]))
                )
                now_s += half_turn_s
                middle, phi_last = middle + float(shifts[nearest]), phi_last + float(shifts[nearest])
            duration_s = turn_s * (u_to - u_from) / (2.0 * math.pi)
            phases.append(Phase(now_s, duration_s, u_from, u_to, sign, middle, 0.0))
            now_s, phi_before = now_s + duration_s, phi_last
        return phases
