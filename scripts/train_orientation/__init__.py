"""Training of the orientation network on people of the virtual lab; see README.md."""
