"""Friction of what presses: Coulomb with a Stribeck step, as a spring that never pulls harder than the law allows.

The energy of a step has the term h sum mu N sqrt(v^2 + v_e^2) (08 section 3). Its slope is a spring towards where the
node was, and with that secant as stiffness the term is majorised: no cycling between slip and slip back. A contact that
slips far in one step is brought there by the tangent, which is quick and needs a look at the energy. mu N lags one step,
normal force and speed alike, so that every step remains the minimisation of one function.
"""

import math

from hal.kernel import kernel

REST_MM_PER_S = 0.02
"""v_e: slower than this a contact counts as resting; it creeps at most so fast."""


@kernel
def coefficient(scala, speed_mm_per_s):
    """mu(v): static at rest, kinetic beyond the Stribeck speed."""
    share = speed_mm_per_s / scala.stribeck_mm_per_s
    return scala.friction + (scala.friction_static - scala.friction) * math.exp(-share * share)


@kernel
def grip(scala, normal_n, slip_mm, step_s):
    """Largest friction [N] of the next step: mu(v) N, with speed and normal force of the step that has just ended."""
    return coefficient(scala, abs(slip_mm) / step_s) * normal_n


@kernel
def reach(slip_mm, step_s):
    """sqrt(slip^2 + (h v_e)^2): friction is grip / reach times the slip, and grip times reach its energy."""
    return math.sqrt(slip_mm * slip_mm + (step_s * REST_MM_PER_S) ** 2)


@kernel
def curb(reach_mm, step_s):
    """Tangent of the law over its secant: what is left of a contact's stiffness once it slips."""
    rest = step_s * REST_MM_PER_S / reach_mm
    return rest * rest
