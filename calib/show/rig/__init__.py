"""The page of a rig: cameras that are held together, solved from what they saw of one target."""
