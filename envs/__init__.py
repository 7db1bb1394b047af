"""Simulated worlds: tasks, the batched simulator, and the one parameter space that describes every robot."""
