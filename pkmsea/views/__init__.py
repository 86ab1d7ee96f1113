"""Showing solutions: tables, figures and the Meshcat playback. Nothing upstream imports this."""

import re


def file_name(setup: str) -> str:
    """A safe file name from a setup's name: 'PKM SEA' becomes 'PKM_SEA'."""
    return re.sub(r"[^\w.+-]+", "_", setup).strip("._") or "setup"
