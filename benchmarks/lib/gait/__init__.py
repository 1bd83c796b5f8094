"""Points, steps and speed of gait against the truth."""
