"""SORT in the image, corrected by odometry."""
