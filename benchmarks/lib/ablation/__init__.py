"""Parts of the ablation, and the calibration of detections."""
