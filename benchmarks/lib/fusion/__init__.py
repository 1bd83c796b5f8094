"""Tracks of several cameras in a scene of the lab, and their scores against the ground truth."""
