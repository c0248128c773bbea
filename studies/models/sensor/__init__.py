"""What the studies on images of the finger share: fingers as made, and what perception is told."""
