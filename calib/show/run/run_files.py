"""The files of a calibration's folder on its page."""

from calib.records.run_folder import RunFolder, Solved
from calib.show.parts.folder_blocks import file_list
from calib.show.parts.gallery import OVERLAYS
from designer.page.blocks import Fold, Section

FILES = (
    ("calibration.json", "the whole solution: camera, poses, covariances"),
    ("camera.json", "the camera, for other commands and programs"),
    ("observations.csv", "each sighting and what is left over of it"),
    ("metrics.json", "errors in summary"),
    ("metrics_views.csv", "errors by photo"),
    ("metrics_faces.csv", "errors by face"),
    ("metrics_points.csv", "errors by ring"),
    ("metrics_observations.csv", "errors by sighting"),
    ("calibration.png", "figures on one sheet"),
)
OF_RUN = (
    ("verdict.json", "what was checked, for programs"),
    ("next_views.json", "photos to take next"),
    ("target.json", "the target as it was used"),
    ("detections.csv", "rings found in the photos"),
    ("detections.records.json", "what was read of each face, and why rings are missing"),
    ("calibration.png", "figures of the recommended model on one sheet"),
    ("comparison.png", "the models on one sheet"),
)


def files_section(run: RunFolder, best: Solved) -> Section:
    """What the folder holds: of the run and of the best camera in sight, of the others behind a click."""
    found = file_list(run.folder, tuple(dict([*OF_RUN, *_of_model(best)]).items()))
    others = [(one, file_list(run.folder, _of_model(one))) for one in run.solved if one is not best]
    count = len(found.rows) + sum(len(files.rows) for _, files in others)
    pictures = f" The overlays of the photos are in {OVERLAYS}/." if (run.folder / OVERLAYS).is_dir() else ""
    folds = tuple(Fold(f"Files of model {one.model}", (files,)) for one, files in others)
    return Section("Files", (found, *folds), lead=f"{count} files beside this page.{pictures}")


def _of_model(one: Solved) -> list[tuple[str, str]]:
    return [(f"{one.path}{name}", purpose) for name, purpose in FILES]
