"""The drawings: pixels in, viser scene nodes out."""
