"""Showing solutions: tables, figures and the Meshcat playback. Nothing upstream imports this."""
