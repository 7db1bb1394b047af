"""Policies and critics as modules."""
