"""Points of a body followed on its surface."""
