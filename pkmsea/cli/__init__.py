"""The command line. Each command imports what it needs, so that --help answers at once."""

from pkmsea import ending
from pkmsea.cli import mechanisms, results, solving, studies
from pkmsea.cli.app import app

__all__ = ["app", "main", "mechanisms", "results", "solving", "studies"]


def main() -> None:
    """Run the command line; errors of pkmsea become one paragraph and an exit code, without a traceback."""
    ending.run(app)
