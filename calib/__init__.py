"""Camera calibration with the targets that `designer` makes."""
