"""Marks of other makers' boards, a file a kind: chessboards, ChArUco boards, AprilGrids, grids of circles."""

MARKS = ("chessboard", "charuco", "aprilgrid", "circles")
"""Names of the kinds, and of their modules, each of which holds its class as `MARKS`."""
