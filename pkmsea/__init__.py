"""pkmsea: energy-optimal motion and spring stiffness of robots with series elastic drives.

The public names; each is imported when it is first used, so that `import pkmsea` is quick.
"""

from importlib import import_module
from importlib.metadata import PackageNotFoundError, version
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from pkmsea.actuation import Actuation, Drive, flat_map
    from pkmsea.description import Description
    from pkmsea.errors import PkmseaError
    from pkmsea.mechanism import Mechanism, build_mechanism, load_mechanism
    from pkmsea.problem import Problem, build_problem
    from pkmsea.solution import Audit, Solution, solve, solve_all
    from pkmsea.solution.export import export
    from pkmsea.solution.store import load as load_solution
    from pkmsea.solver import Optimality, Optimum
    from pkmsea.study import Study, StudyResult, load_study, run_study
    from pkmsea.study.calibrate import calibrate
    from pkmsea.task import Cycle, Limits, OperatingPoint, Options, Setup, Task, load_task
    from pkmsea.transcription import Transcription, transcribe
    from pkmsea.verification import Verification, verify

_WHERE = {
    "Actuation": "actuation", "Drive": "actuation", "flat_map": "actuation",
    "Description": "description",
    "PkmseaError": "errors",
    "Mechanism": "mechanism", "build_mechanism": "mechanism", "load_mechanism": "mechanism",
    "Problem": "problem", "build_problem": "problem",
    "Audit": "solution", "Solution": "solution", "solve": "solution", "solve_all": "solution",
    "export": "solution.export", "load_solution": "solution.store:load",
    "Optimality": "solver", "Optimum": "solver",
    "Study": "study", "StudyResult": "study", "calibrate": "study", "load_study": "study", "run_study": "study",
    "Cycle": "task", "Limits": "task", "OperatingPoint": "task", "Options": "task", "Setup": "task", "Task": "task",
    "load_task": "task",
    "Transcription": "transcription", "transcribe": "transcription",
    "Verification": "verification", "verify": "verification",
}  # fmt: skip

__all__ = [
    "Actuation", "Audit", "Cycle", "Description", "Drive", "Limits", "Mechanism", "OperatingPoint", "Optimality",
    "Optimum", "Options", "PkmseaError", "Problem", "Setup", "Solution", "Study", "StudyResult", "Task",
    "Transcription", "Verification", "build_mechanism", "build_problem", "calibrate", "export", "flat_map",
    "load_mechanism", "load_solution", "load_study", "load_task", "run_study", "solve", "solve_all", "transcribe",
    "verify",
]  # fmt: skip


try:
    __version__ = version("pkmsea")
except PackageNotFoundError:  # the sources alone
    __version__ = "unknown"


def __getattr__(name: str) -> Any:
    if name not in _WHERE:
        raise AttributeError(f"module 'pkmsea' has no attribute '{name}'")
    module, _, attribute = _WHERE[name].partition(":")
    return getattr(import_module(f"pkmsea.{module}"), attribute or name)


def __dir__() -> list[str]:
    return sorted(__all__)
