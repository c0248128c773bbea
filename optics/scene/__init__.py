"""Camera, mirrors, pads and blockers in section, their errors of fabrication, and their file."""
