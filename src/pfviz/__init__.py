"""Particle filters you can see."""
