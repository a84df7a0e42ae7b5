"""Calibrations and evaluations as files and tables."""
