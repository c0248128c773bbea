"""An independent judge of views: it imports nothing of ours and traces rays with Mitsuba 3.

It reads the plain tables of a scene file, poses them, builds solids and asks Mitsuba where rays
go; reflection, Snell's law and Fresnel's formulas are Mitsuba's own.
`boards` has pictures of calibration boards through random wide lenses.
"""
