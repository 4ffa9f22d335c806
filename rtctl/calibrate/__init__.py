"""Calibration of robot and sensor (05; D Chapter III, Appendix A): fits, the runs that feed them, and what they leave."""
