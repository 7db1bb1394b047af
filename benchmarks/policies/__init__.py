"""Policies of other libraries, and the interfaces that they were trained with."""
