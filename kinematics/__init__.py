"""Planar linkages: from a sketch to poses, rates, transmission and statics."""
