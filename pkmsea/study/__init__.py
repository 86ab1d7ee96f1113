"""Many solves: studies of a task's numbers, and calibration of drive numbers."""

from pkmsea.study.calibrate import calibrate, with_drive_numbers
from pkmsea.study.result import StudyResult
from pkmsea.study.run import run_study
from pkmsea.study.runner import Progress
from pkmsea.study.study import Study, load_study

__all__ = ["Progress", "Study", "StudyResult", "calibrate", "load_study", "run_study", "with_drive_numbers"]
