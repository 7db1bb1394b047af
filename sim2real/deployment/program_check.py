"""A torch.export archive, read as data: refused if loading it could execute code.

    check_program("policy.pt2")                    # then torch.export.load is safe

The loader of torch looks operators up by name, evaluates the expressions of dynamic sizes, and
unpickles tensors that plain loading refuses. So each name must be an operator of aten, each
expression made of symbols and arithmetic, each pickle one of tensors alone, and nothing compiled.
"""

import io
import json
import re
import zipfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import torch

from sim2real.runs.errors import Sim2RealError

OPERATOR = re.compile(r"torch\.ops\.aten\.\w+\.\w+")
SYMBOL = r"Symbol\('[su]\d+'(?:, \w+=(?:True|False))*\)"
ARITHMETIC = re.compile(
    rf"(?:{SYMBOL}|Add|Mul|Pow|Max|Min|Mod|Integer|Rational|[su]\d+|\d+|[\s(),*+/-])*"
)
COMPILED = ("aotinductor", "custom_obj", "opaque_obj", "executorch", ".so", ".py")


class ActorError(Sim2RealError):
    """A policy's file cannot be read, or could execute code."""


def check_program(path: Path) -> None:
    """Refuse an archive that is not data alone.

    Raises:
        ActorError: with the file and what in it could execute.
    """
    try:
        with zipfile.ZipFile(path) as archive:
            contents = {name: archive.read(name) for name in archive.namelist()}
    except (OSError, zipfile.BadZipFile) as error:
        raise ActorError(f"{path}: not a torch.export archive ({error})") from None
    for name, content in contents.items():
        if any(word in name for word in COMPILED):
            raise ActorError(f"{path}: {name} in it is code; export the policy without it")
        if name.endswith(".json"):
            _check_json(path, name, content)
        elif name.endswith(".pt") or content[:2] in (b"PK", b"\x80\x02"):
            _check_tensors(path, name, content)


def _check_json(path: Path, name: str, content: bytes) -> None:
    try:
        facts = json.loads(content)
    except ValueError:
        raise ActorError(f"{path}: {name} in it is damaged; export the policy again") from None
    for key, value in _strings(facts):
        operator = key != "target" or OPERATOR.fullmatch(value)
        sizes = key != "expr_str" or ARITHMETIC.fullmatch(value)
        if not operator or not sizes:
            raise ActorError(
                f"{path}: {value[:80]!r} in {name} is neither an operator of aten nor a size; "
                "loading it could execute code, so it is rejected"
            )


def _strings(node: Any, key: str = "") -> Iterator[tuple[str, str]]:
    """Yield every text of a JSON tree with the key that it stands under."""
    if isinstance(node, dict):
        for name, value in node.items():
            yield from _strings(value, name)
    elif isinstance(node, list):
        for value in node:
            yield from _strings(value, key)
    elif isinstance(node, str):
        yield key, node


def _check_tensors(path: Path, name: str, content: bytes) -> None:
    try:
        torch.load(io.BytesIO(content), weights_only=True)
    except Exception:  # torch raises many kinds, none of which may pass
        raise ActorError(
            f"{path}: {name} in it contains more than tensors; loading it could execute code, so "
            f"it is rejected; export the policy again"
        ) from None
