"""What the studies on images of the finger share: fingers as made, their models for images."""
