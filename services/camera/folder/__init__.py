"""Folders of images as RGB-D sources."""
