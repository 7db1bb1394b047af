"""The rows: one module for each kind of thing that makes environment steps."""
