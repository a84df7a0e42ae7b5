"""What the commands of `calib` answer to a program; docs/json.md says what the keys mean."""
