"""Scenes and chambers as named numbers that can be turned and optimised."""
