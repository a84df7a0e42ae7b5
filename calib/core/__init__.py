"""What every room of the calibration uses: types, motions, linear algebra, compiled loops, files."""
