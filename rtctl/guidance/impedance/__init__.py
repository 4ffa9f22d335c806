"""Bipolar impedance of the electrode contacts: what it is near a wall, and how it guides the stylet (04; D Chapter VII)."""
