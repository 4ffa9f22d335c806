"""Hardware in the loop: the emulated bench beside a controller, what it is compared with, and what is broken on it."""
