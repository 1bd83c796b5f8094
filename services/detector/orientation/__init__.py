"""Yaw of detected people from their keypoints (docs/method.md sections 6 and 11)."""
