"""Linkages and their motion drawn with Matplotlib."""
