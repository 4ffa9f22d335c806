"""Settings files that ship with rtctl; each runs as it is."""
