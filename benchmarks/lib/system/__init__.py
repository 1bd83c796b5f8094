"""Systems that run: services, cameras, viewers, and what is measured of them."""
