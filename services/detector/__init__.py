"""RGB-D frames to people: box, score, keypoints or mask, 3D position, heading, crop."""
