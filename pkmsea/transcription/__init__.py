"""Making a problem finite: bases, the flat transcription with its exact derivatives, and the paper's own."""

from pkmsea.motion import Basis
from pkmsea.problem import Problem
from pkmsea.transcription.base import Transcription
from pkmsea.transcription.default import FlatTranscription
from pkmsea.transcription.paper import PaperTranscription

__all__ = ["TRANSCRIPTIONS", "Transcription", "transcribe", "transcribe_on"]

TRANSCRIPTIONS: dict[str, type[Transcription]] = {"flat": FlatTranscription, "paper": PaperTranscription}


def transcribe(problem: Problem) -> Transcription:
    """The transcription that the problem's options name; nothing is solved yet."""
    return TRANSCRIPTIONS[problem.options.transcription].of(problem)


def transcribe_on(problem: Problem, basis: Basis, samples: int) -> Transcription | None:
    """The transcription of a solved motion's own mesh; None where the options name one that has none."""
    return TRANSCRIPTIONS[problem.options.transcription].on(problem, basis, samples)
