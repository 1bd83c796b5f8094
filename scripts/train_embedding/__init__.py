"""Training of the appearance network on people of the virtual lab; see README.md."""
