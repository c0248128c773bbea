"""Matplotlib figures: house style, names set for readers, and what is drawn many times a second."""
