"""Why there is no output: what is gathered of a system, and what is concluded from it."""
