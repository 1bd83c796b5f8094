"""Pictures of people: annotated frames, top views, grids of tiles."""
