"""Commands on pictures of a finger: they need optics and perception both, or whole fingers."""
