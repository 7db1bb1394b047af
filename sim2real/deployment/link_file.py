"""`link.json` in a deployment's folder: periods, overruns and answers, see `hardware/link.py`.

It is of the episodes since the deployment began or, where it was interrupted, went on.
"""

import json
from pathlib import Path
from typing import Any

from hardware.link import LinkStatistics
from sim2real.runs.files import write_text

LINK = "link.json"


def write_link(folder: Path, link: LinkStatistics | None) -> None:
    """Write what is known of a deployment's link; nothing where there are no servos."""
    if link is not None:
        write_text(folder / LINK, json.dumps(link.as_dict(), indent=1, ensure_ascii=False) + "\n")


def read_link(folder: Path) -> dict[str, Any] | None:
    """Return the content of a deployment's file; None if there is no file."""
    path = folder / LINK
    return json.loads(path.read_text(encoding="utf-8")) if path.is_file() else None
