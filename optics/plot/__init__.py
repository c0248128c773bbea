"""Scenes, chambers and views drawn with Matplotlib."""
