"""Tests of the visual odometry."""
