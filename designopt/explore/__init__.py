"""The command ``designopt explore``: a bench in a window or on a page, its knobs as sliders."""
