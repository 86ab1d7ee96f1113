"""Making a problem finite: bases, the flat transcription with its exact derivatives, and the paper's own."""

from pkmsea.actuation.cost import ENERGY
from pkmsea.errors import InputError
from pkmsea.problem import Problem
from pkmsea.task import Chain
from pkmsea.transcription.base import Transcription
from pkmsea.transcription.bases import Basis
from pkmsea.transcription.motion import Motion

__all__ = ["Motion", "Transcription", "transcribe", "transcribe_on"]


def transcribe(problem: Problem) -> Transcription:
    """The transcription that the problem's options name; nothing is solved yet."""
    options = problem.options
    if options.transcription == "paper":
        _refuse_extras(problem)
        from pkmsea.transcription.paper import PaperTranscription

        return PaperTranscription(problem)
    from pkmsea.transcription.default import FlatTranscription

    assert not isinstance(options.trajectory, Chain)  # the task file's check
    return FlatTranscription(problem, options.trajectory, options.samples)


def transcribe_on(problem: Problem, basis: Basis, samples: int) -> Transcription | None:
    """The transcription of a solved motion's own mesh; None where the options name the paper's, which has none."""
    if problem.options.transcription == "paper":
        return None
    from pkmsea.transcription.default import FlatTranscription

    return FlatTranscription(problem, basis.trajectory, samples)


def _refuse_extras(problem: Problem) -> None:
    """The paper's transcription knows neither parallel springs nor damped ones, no payload, no other cost."""
    shape = problem.actuation.shape
    damped = any(kind.remembers for kind in shape.kinds)
    another = problem.cost != ENERGY
    present = {"cost": another, "parallel": shape.parallel, "damping": damped, "payload": shape.payload}
    for key, found in present.items():
        if found:
            raise InputError(f"The paper's transcription has no {key}.", "Use options.transcription: flat.", key=key)
