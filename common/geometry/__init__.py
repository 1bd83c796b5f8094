"""Rigid transforms, cameras, boxes, frames over time."""
