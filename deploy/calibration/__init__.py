"""Page with the result of a calibration."""
