"""Where a study's files lie in its folder."""

STUDY_FILE = "study.sqlite"
FIGURES_FOLDER = "figures"
