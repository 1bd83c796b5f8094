"""Tests of the calibration by walking."""
