"""Commands that simulate, evaluate and measure offline."""
