"""People of all areas of a site in one stream."""
