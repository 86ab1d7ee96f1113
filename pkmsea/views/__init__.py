"""Showing solutions: tables, figures and the Meshcat playback. Nothing upstream imports this."""

from pkmsea.files import file_name

__all__ = ["file_name"]
