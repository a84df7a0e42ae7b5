"""From observations to calibrations of several models."""
