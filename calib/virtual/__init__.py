"""The virtual camera: learning the map that turns a camera into a perfect pinhole, and the pinhole behind it."""
