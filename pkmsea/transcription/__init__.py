"""Making a problem finite: bases, the flat transcription with its exact derivatives, and the paper's own."""

from pkmsea.problem import Problem
from pkmsea.task import Chain
from pkmsea.transcription.base import Transcription
from pkmsea.transcription.motion import Motion

__all__ = ["Motion", "Transcription", "transcribe"]


def transcribe(problem: Problem) -> Transcription:
    """The transcription that the problem's options name; nothing is solved yet."""
    options = problem.options
    if options.transcription == "paper":
        from pkmsea.transcription.paper import PaperTranscription

        return PaperTranscription(problem)
    from pkmsea.transcription.default import FlatTranscription

    assert not isinstance(options.trajectory, Chain)  # the task file's check
    return FlatTranscription(problem, options.trajectory, options.samples)
