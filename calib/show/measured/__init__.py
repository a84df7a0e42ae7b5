"""The page of a measured target."""
