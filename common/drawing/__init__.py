"""Pictures of people: frames with boxes and skeletons, maps from above, pages of tiles."""
