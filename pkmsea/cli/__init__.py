"""The command line. Each command imports what it needs, so that --help answers at once."""

from __future__ import annotations

import contextlib
import os
import tempfile
from collections.abc import Iterator

from pkmsea import ending
from pkmsea.cli import mechanisms, results, solving, studies
from pkmsea.cli.app import app

__all__ = ["app", "main", "mechanisms", "results", "solving", "studies"]


def main() -> None:
    """Run the command line; errors of pkmsea become one paragraph and an exit code, without a traceback."""
    with _folder_for_matplotlib():
        ending.run(app)


@contextlib.contextmanager
def _folder_for_matplotlib() -> Iterator[None]:
    """Give matplotlib a folder for its list of fonts that is gone at the end: it would write to the user's home, or
    complain that there is none."""
    with contextlib.ExitStack() as stack:
        if "MPLCONFIGDIR" not in os.environ:
            with contextlib.suppress(OSError):  # no folder for temporary files: matplotlib finds a way of its own
                os.environ["MPLCONFIGDIR"] = stack.enter_context(tempfile.TemporaryDirectory(prefix="pkmsea-"))
        yield
