"""Tests of the skeletons."""
