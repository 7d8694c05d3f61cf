"""The pfviz app: particle filters on screen, in the browser."""
