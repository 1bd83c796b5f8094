"""Recordings of real people with marks made by hand, and variations of them."""
