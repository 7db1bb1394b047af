"""Pages for a person, made from a template: names that come from files are escaped in it.

template(Path("page/report.html")).render(title="…")
"""

from collections.abc import Callable
from pathlib import Path

import jinja2


def template(path: Path, *filters: Callable[..., str]) -> jinja2.Template:
    """Return a page's template, which knows these functions as filters by their names."""
    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader(path.parent),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters |= {one.__name__: one for one in filters}
    return environment.get_template(path.name)
