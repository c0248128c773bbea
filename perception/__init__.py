"""OpenCV on images: masks, quads, unwarping, joint angles, directions and posture."""
