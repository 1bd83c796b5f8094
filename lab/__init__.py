"""A virtual motion-capture lab: RGB-D video of walking people with exact truth."""
