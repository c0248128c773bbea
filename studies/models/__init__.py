"""Whole designs and their methods, which several studies share."""
