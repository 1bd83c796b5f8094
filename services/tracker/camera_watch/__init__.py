"""Watch of several cameras by the people that the others find."""
