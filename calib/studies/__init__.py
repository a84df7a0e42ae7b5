"""Studies: what many calibrations say together."""
