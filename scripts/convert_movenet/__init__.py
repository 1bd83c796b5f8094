"""The shipped MoveNet from the model of an npm package."""
