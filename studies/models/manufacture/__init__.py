"""The finger as parts to make: bars, pins, phalanges with their seats, mirrors, pads and camera."""
