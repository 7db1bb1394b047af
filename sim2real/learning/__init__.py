"""Learning: environments with transforms, policies, losses, algorithms, populations, adaptation."""
