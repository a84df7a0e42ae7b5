"""Whether a calibration is good: what is checked, against which limits, and what would make it better."""
