"""Programs for the development of people4d; none runs on a robot."""
