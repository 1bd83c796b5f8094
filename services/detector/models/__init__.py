"""People models: an image in, people with box, score and keypoints or mask out."""
