"""One HTML file out of its parts: skeleton, style, scripts, data; it loads nothing and runs its own script alone."""

import json
from base64 import b64encode
from collections.abc import Mapping, Sequence
from functools import cache
from hashlib import sha256
from html import escape
from importlib.resources import files

from ccm_opt.files.report.markup import Markup

_FOLDER = "ccm_opt.files.report"
COMMON = ("elements", "numbers", "sampled", "arm", "timeline", "viewport", "scene", "marks", "theme", "controls")
"""Scripts that every page with a scene has, in the order in which they are needed."""


def html_document(title: str, body: Markup, data: Mapping[str, object], scripts: Sequence[str]) -> str:
    """A whole page.

    Args:
        title: of the window, plain text.
        body: of the page.
        data: what its scripts read, as JSON.
        scripts: names of files in ``script``, without their ending, in order.
    """
    script = '"use strict";\n' + "\n".join(_resource(f"script/{name}.js") for name in scripts)
    digest = b64encode(sha256(script.encode()).digest()).decode()
    parts = {
        "title": escape(title),
        "hash": f"sha256-{digest}",
        "style": _resource("page.css"),
        "body": body,
        "data": json_for_html(data),
        "script": script,
    }
    # Split first and filled once: what is filled in is never searched for further places.
    first, *others = _resource("page.html").split("{{")
    filled = [first]
    for part in others:
        name, rest = part.split("}}", maxsplit=1)
        filled += [parts[name], rest]
    return "".join(filled)


def json_for_html(data: Mapping[str, object]) -> str:
    """JSON that can neither end nor begin an element of HTML."""
    text = json.dumps(data, separators=(",", ":"), ensure_ascii=False, allow_nan=False)
    return text.replace("<", "\\u003c").replace(">", "\\u003e").replace("&", "\\u0026")


@cache
def _resource(name: str) -> str:
    return files(_FOLDER).joinpath(name).read_text(encoding="utf-8")
