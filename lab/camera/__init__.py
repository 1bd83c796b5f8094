"""The simulated camera on its robot: frames, motion, wheel odometry, detections."""
