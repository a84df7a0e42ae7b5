"""Whether a calibration is good: what is checked, against which limits, and what to photograph next."""
