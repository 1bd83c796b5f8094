"""Recordings without faces: heads covered in colour, or no colour at all."""
