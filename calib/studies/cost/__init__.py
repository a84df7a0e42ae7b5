"""Which distances to minimise: those in the image or in space, measured on the same sightings."""
