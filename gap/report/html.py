"""A page as one HTML file that needs no network.

It carries plotly.js (some 5 MB) and a content security policy that lets its own scripts run and
nothing be fetched, so that neither a library nor a name in the user's files can change that.
"""

from __future__ import annotations

import base64
import hashlib
from importlib.resources import files
from pathlib import Path
from typing import Any

import jinja2
import plotly.offline

_OURS = "walkerkit.gap.report"


def write_html(path: str | Path, template: str, *, package: str = _OURS, **content: Any) -> None:
    """Fills in a template and writes it; whatever is filled in is escaped.

    Args:
        path: the HTML file; an existing one is replaced.
        template: its name in the package's assets; it extends `page.html.j2`, which is here.
        package: whose assets.
        **content: what the template names; `figures` are plotly's, by the identifiers of their
            places in the page.

    Raises:
        OSError: the file cannot be written.
    """
    plotly_js = plotly.offline.get_plotlyjs()
    page_js = _asset("report.js")
    environment = jinja2.Environment(
        loader=jinja2.ChoiceLoader([_loader(package), _loader(_OURS)]),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    page = environment.get_template(template).render(
        **content,
        style=_asset("report.css"),
        plotly_js=plotly_js,
        page_js=page_js,
        script_hashes=[_hash(plotly_js), _hash(page_js)],
    )
    Path(path).write_bytes(page.encode())


def _loader(package: str) -> jinja2.BaseLoader:
    return jinja2.FileSystemLoader(str(files(package) / "assets"))


def _asset(name: str) -> str:
    return (files(_OURS) / "assets" / name).read_text(encoding="utf-8")


def _hash(script: str) -> str:
    """The script's name in a content security policy."""
    return f"sha256-{base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()}"
