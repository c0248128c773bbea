"""The command ``designopt explore``: a design on a page of a browser, its numbers as sliders."""
