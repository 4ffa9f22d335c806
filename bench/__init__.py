"""The speed of rtctl, measured on the machine it runs on: `make bench`.

Every figure that can be is a ratio against a reference measured in the same run, in turns, because the absolute figures
of a machine shared with others mean little.
"""
