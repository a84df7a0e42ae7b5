"""Marks of other makers' boards, a file a kind: chessboards, ChArUco boards, AprilGrids, grids of circles."""
