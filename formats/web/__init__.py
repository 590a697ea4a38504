"""Scenes for the web: one page that needs nothing else, or a folder for any host of files."""
