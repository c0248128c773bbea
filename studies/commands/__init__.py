"""Commands on real pictures: they need optics and perception both."""
