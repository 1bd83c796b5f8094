"""One stream of the people of all areas of a site."""
