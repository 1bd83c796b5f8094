"""Result of a calibration, for people."""
