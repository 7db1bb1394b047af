"""A trained policy on a robot: sessions, adaptation there, export, the live window."""
