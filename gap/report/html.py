"""A page as one HTML file that needs no network.

It carries plotly.js and its data, both packed (`embedded`), and a content security policy that lets
its own scripts run and nothing be fetched, so that neither a library nor a name in the user's files
can change that. Browsers unpack such data since 2023.
"""

from __future__ import annotations

import base64
import gzip
import hashlib
import json
from functools import lru_cache
from importlib.resources import files
from pathlib import Path
from typing import Any

import jinja2
import plotly.offline

MOST = 3_000_000
"""Bytes of a page, at which what it draws is drawn more coarsely."""
_OURS = "walkerkit.gap.report"
_SCRIPTS = ("view.js", "moving.js", "report.js")


def write_html(path: str | Path, template: str, *, package: str = _OURS, **content: Any) -> None:
    """Fills in a template and writes it; whatever is filled in is escaped.

    Args:
        path: the HTML file; an existing one is replaced.
        template: its name in the package's assets; it extends `page.html.j2`, which is here.
        package: whose assets.
        **content: as for `page`.

    Raises:
        OSError: the file cannot be written.
    """
    Path(path).write_bytes(page(template, package=package, **content).encode())


def page(template: str, *, package: str = _OURS, **content: Any) -> str:
    """A filled-in template.

    Args:
        template: its name in the package's assets.
        package: whose assets.
        **content: what the template names; `figures` are plotly's, by the identifiers of their
            places in the page, and `data` is `embedded`, by the names that scripts know it by.
    """
    environment = jinja2.Environment(
        loader=jinja2.ChoiceLoader([_loader(package), _loader(_OURS)]),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    scripts = [_asset(name) for name in _SCRIPTS]
    plotly_hash, plotly_js = _plotly()
    return environment.get_template(template).render(
        **{"data": {}, **content},
        style=_asset("report.css"),
        plotly_js=plotly_js,
        scripts=scripts,
        script_hashes=[plotly_hash, *map(_hash, scripts)],
    )


def embedded(value: Any) -> str:
    """A value as a page carries it: JSON, packed, in letters that need no escaping."""
    return _packed(json.dumps(value, separators=(",", ":"), allow_nan=False))


def unembedded(text: str) -> Any:
    """What `embedded` was given, as report.js reads it."""
    return json.loads(gzip.decompress(base64.b64decode(text)))


@lru_cache(maxsize=1)
def _plotly() -> tuple[str, str]:
    """The name of plotly.js in a content security policy, and the library, packed."""
    script = plotly.offline.get_plotlyjs()
    return _hash(script), _packed(script)


def _packed(text: str) -> str:
    return base64.b64encode(gzip.compress(text.encode(), 9, mtime=0)).decode()


def _loader(package: str) -> jinja2.BaseLoader:
    return jinja2.FileSystemLoader(str(files(package) / "assets"))


def _asset(name: str) -> str:
    return (files(_OURS) / "assets" / name).read_text(encoding="utf-8")


def _hash(script: str) -> str:
    """The script's name in a content security policy."""
    return f"sha256-{base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()}"
