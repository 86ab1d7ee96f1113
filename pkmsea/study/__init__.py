"""Many solves: calibration of drive numbers."""

from pkmsea.study.calibrate import calibrate, with_drive_numbers

__all__ = ["calibrate", "with_drive_numbers"]
