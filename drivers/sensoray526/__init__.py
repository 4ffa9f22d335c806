"""Sensoray 526: four 24-bit counters, eight differential inputs, four outputs, eight digital lines (07 section 1)."""
