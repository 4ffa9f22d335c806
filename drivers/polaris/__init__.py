"""NDI Polaris, an optical pose tracker: for calibrations, in a process of its own, never in the loop (07 section 5)."""
