"""Tests of the gait service."""
