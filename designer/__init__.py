"""Design and fabrication of camera-calibration targets (kept free of imports: `calib` loads it)."""
