"""StrongSORT-3D and the policies around it."""
