"""From photos to the printed target: camera, poses and geometry in one adjustment."""
