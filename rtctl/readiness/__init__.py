"""Is this machine ready for real time? What it is, what that costs, and the one command that mends it."""
