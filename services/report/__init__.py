"""Records a running pipeline and writes a page, videos and a summary."""
