"""From observations to a calibrated camera: start, Levenberg-Marquardt with the poses eliminated, covariance."""
