"""Motor of an emulated drive: electrical and mechanical, with the drive's own current loop."""

import math

SUBSTEP_S = 2.5e-4


class Rotor:
    """A small brushed motor with its screw, turned by a current; what it drives is not felt.

    Attributes:
        angle_rad, rate_rad_per_s, current_a: state.
    """

    torque_nm_per_a = 0.025
    resistance_ohm = 2.0
    supply_v = 24.0
    inertia_kg_m2 = 2.0e-6
    coulomb_nm = 1.0e-3
    viscous_nm_s = 1.0e-6
    current_lag_s = 3.0e-4

    def __init__(self) -> None:
        self.angle_rad = self.rate_rad_per_s = self.current_a = 0.0

    def turn(self, current_a: float, closed: bool, dt_s: float) -> None:
        """Through `dt_s` towards the current asked for; an open circuit (`closed` False) lets it coast."""
        steps = max(1, round(dt_s / SUBSTEP_S))
        dt_s /= steps
        for _ in range(steps):
            emf_v = self.torque_nm_per_a * self.rate_rad_per_s
            low, high = (-self.supply_v - emf_v) / self.resistance_ohm, (self.supply_v - emf_v) / self.resistance_ohm
            wanted = min(max(current_a, low), high)
            blend = dt_s / (self.current_lag_s + dt_s)
            self.current_a = self.current_a + blend * (wanted - self.current_a) if closed else 0.0
            torque_nm = self.torque_nm_per_a * self.current_a - self.viscous_nm_s * self.rate_rad_per_s
            rate = self.rate_rad_per_s + torque_nm * dt_s / self.inertia_kg_m2
            brake = self.coulomb_nm * dt_s / self.inertia_kg_m2
            self.rate_rad_per_s = math.copysign(max(abs(rate) - brake, 0.0), rate)
            self.angle_rad += self.rate_rad_per_s * dt_s
