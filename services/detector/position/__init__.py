"""3D positions of detected people."""
