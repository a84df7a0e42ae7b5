"""The ring detector: from a photo's pixels to named centres with covariances."""
