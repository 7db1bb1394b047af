"""Populations: many policies at once in batched environments, here or on a cluster."""
