"""What a report says of the link over which its logs were recorded; see `hardware/link.py`.

inputs["link"] = links(logs)            # of the logs whose metadata tell it
table(inputs)                           # a row for each servo of each of them
"""

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from hardware.link import PERCENTILES
from hardware.log import Log


def links(logs: Iterable[Log]) -> dict[str, Mapping[str, Any]]:
    """Return what the metadata of logs tell of their link, by the name of the log's file."""
    return {
        log.path.name if log.path else f"log {number}": log.meta["link"]
        for number, log in enumerate(logs, 1)
        if "link" in log.meta
    }


def table(inputs: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Return the rows of the page's table: one for each servo; times in milliseconds."""
    rows = []
    for name, quality in inputs.get("link", {}).items():
        period = quality["period"]
        times = [f"{1e3 * period[f'p{p}']:.1f}" if period else "–" for p in PERCENTILES]
        score = quality.get("score")
        common = {
            "log": Path(name).name,
            "periods": times,
            "overruns": quality["overruns"],
            "score": "–" if score is None else f"{score['score']:.2f}",
        }
        rows += [common | {"servo": servo, **counts} for servo, counts in quality["servos"].items()]
    return rows
