"""The commands of `calib`, one a file: thin, and the only place with a screen."""
