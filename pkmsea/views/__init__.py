"""Showing solutions: tables, figures and the Meshcat playback. Nothing upstream imports this."""

import re
import unicodedata
from itertools import chain, count

from pkmsea.task import Task

LONGEST = 120  # bytes of a file name without suffix; file systems allow 255 of the whole


def file_name(task: Task, setup: str) -> str:
    """A safe file name, without suffix, for a setup of a task: 'PKM SEA' becomes 'PKM_SEA'.

    Setups of one task never share one, whatever the case of letters: the second gets '-2', and so on.
    """
    taken: set[str] = set()
    for name in (other.name for other in task.setups):
        plain = re.sub(r"[^\w.+-]+", "_", unicodedata.normalize("NFKC", name)).strip("._")
        plain = plain.encode()[:LONGEST].decode(errors="ignore") or "setup"
        free = next(x for x in chain([plain], (f"{plain}-{i}" for i in count(2))) if x.casefold() not in taken)
        if name == setup:
            return free
        taken.add(free.casefold())
    raise ValueError(f"the task has no setup '{setup}'")
