"""What to photograph next, while photos are taken: from what a frame shows to whether it is worth taking."""
