"""Train policies in simulation that survive the real robot; find what separates the two."""
