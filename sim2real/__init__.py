"""Train policies in simulation that survive, and adapt to, the real robot; find what separates the two."""
