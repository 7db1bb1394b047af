"""MuJoCo's names live in a compiled module that carries no types; each of them is Any here."""

from typing import Any

def __getattr__(name: str) -> Any: ...
