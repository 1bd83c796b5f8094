"""Parts of the ablation, and the errors of measured velocities."""
