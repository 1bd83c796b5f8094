"""Hand-over of identities between the trackers of neighbouring areas."""
