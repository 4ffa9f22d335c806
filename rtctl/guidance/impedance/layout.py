"""Records of impedance guidance in the memory of the tick: the parameters of the law, and what it knows of every pair.

Contacts count from the tip, 0 to 21; pair k is contacts k and k + `pair_step`, 21 or 20 of them in a sweep.
"""

import numpy as np

CONTACTS = 22
PAIRS = CONTACTS - 1
"""Room for the pairs of a sweep; with a step of 2 the last stays empty."""
CONTINUOUS, STEPWISE = 0, 1
MODES = {"continuous": CONTINUOUS, "stepwise": STEPWISE}
"""Names of the modes in the settings."""
BLIND_REACTIONS = ("note", "pause")

MOVING, MEASURING, CORRECTING, CONFIRMING, READY = 0, 1, 2, 3, 4
"""Phases of the stepwise mode at a rest; the continuous one has none and stays MOVING."""

LAW = np.dtype(
    [
        ("on", "i8"),
        ("mode", "i8"),
        ("pause_when_blind", "i8"),
        ("pair_step", "i8"),
        ("pairs", "i8"),
        ("least_pairs", "i8"),
        ("pair_age_ticks", "i8"),
        ("link_age_ticks", "i8"),
        ("interval_mm", "f8"),
        ("step_limit_mm", "f8"),
        ("factor_ohm", "f8"),
        ("exponent", "f8"),
        ("far_field_ohm", "f8"),
        ("area_max_mm2", "f8"),
        ("open_ohm", "f8"),
        ("short_ohm", "f8"),
        ("noise_limit_ohm", "f8"),
        ("pitch_mm", "f8"),
        ("place_mm", "f8", (CONTACTS,)),  # s of every contact, from the grip
        ("length_mm", "f8"),  # of the array, s of its tip
        ("modal_matrix", "f8", (4, 4)),
        ("bias_ohm", "f8", (PAIRS,)),  # r
        ("left_out", "i8", (PAIRS,)),
    ],
    align=True,
)
"""Part of a parameter set."""

PAIR_STORE = np.dtype(
    [
        ("awake", "i8"),  # the law was on in the last tick
        ("sequence", "i8"),  # of the last sample taken
        ("sampled", "i8", (PAIRS,)),  # there is a sample, whatever it was
        ("sample_tick", "i8", (PAIRS,)),
        ("z_ohm", "f8", (PAIRS,)),  # last believable sample without its bias; NaN for none
        ("change_ohm", "f8", (PAIRS,)),  # of it against the one before; NaN for none
        ("noise_ohm2", "f8", (PAIRS,)),  # estimated variance
        ("baseline_ohm", "f8", (PAIRS,)),  # z_(j-1); NaN where the pair was not usable then
        ("depth_mm", "f8"),  # in the last tick
        ("evaluated", "i8"),  # number of the interval of the last evaluation, -1 for none
        ("phase", "i8"),
        ("rest_tick", "i8"),  # since when every sample is one at rest
        ("owed_mm", "f8"),  # withdrawal still to be added
        ("rate_mm_per_mm", "f8"),  # at which it is, by depth
        ("offset_mm", "f8"),  # withdrawal added so far
        ("step_mm", "f8"),  # of the last evaluation
        ("jacobian_ohm_per_mm", "f8"),  # |J| of it
        ("gain", "f8", (CONTACTS,)),  # n_k.J_pqs of it [mm/mm]
    ],
    align=True,
)
"""What is known of the pairs, and of the insertion under way."""
