"""Annotated recordings of real people, and augmentations of them."""
