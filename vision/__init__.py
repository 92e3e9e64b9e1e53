"""One image and a search window in, one fix out."""
