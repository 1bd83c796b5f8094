"""How people walk in a recording: points of their bodies, steps, tables and pictures."""
