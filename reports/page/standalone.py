"""What makes a page standalone: its data, its scripts and plotly.js, all inside the HTML."""

from __future__ import annotations

import json
from importlib.resources import files
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from markupsafe import Markup

from nrsfm.harness.record.errors import UsageError
from nrsfm.reports.figures.page_data import Blobs, deflated
from nrsfm.reports.figures.style import COLOURS
from nrsfm.reports.formats.documents import HTML

LIBRARY = "package_data/plotly.min.js"


def render_page(name: str, data: dict[str, Any], blobs: Blobs, **context: Any) -> str:
    """The template ``NAME.html.j2`` with its script ``NAME.js``, the data that the script reads, and plotly.js.

    Raises
    ------
    UsageError
        If plotly is not installed.
    """
    return HTML.get_template(f"{name}.html.j2").render(
        page=True,
        data=script_json({**data, "blobs": blobs.held, "colours": COLOURS}),
        library=Markup(deflated(plotly().encode())),
        script=Markup("\n").join(map(_script, ("player.js", f"{name}.js"))),
        **context,
    )


def script_json(data: Any) -> Markup:
    """Data as JSON inside a script element: no text in it can end the element."""
    text = json.dumps(data, separators=(",", ":"), sort_keys=True, allow_nan=False)
    return Markup(text.replace("<", "\\u003c").replace(">", "\\u003e").replace("&", "\\u0026"))


def plotly() -> str:
    """The plotly.js that the plotly package ships."""
    package = find_spec("plotly")
    if package is None or package.origin is None:
        raise UsageError("the page needs plotly; install it with 'pip install plotly'")
    return (Path(package.origin).parent / LIBRARY).read_text(encoding="utf-8")


def _script(name: str) -> Markup:
    return Markup(files("nrsfm.reports.templates").joinpath(name).read_text(encoding="utf-8"))
