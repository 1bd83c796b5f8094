"""RGB-D frame to people: box, score, keypoints or mask, 3D position, crop."""
