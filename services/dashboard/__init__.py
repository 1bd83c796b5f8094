"""Page in the browser: people in images, on a map and in 3D, health and events."""
