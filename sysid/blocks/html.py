"""The frame that pages share: how a template that extends `templates/frame.html` is filled in."""

from __future__ import annotations

import datetime
import functools
import re
from collections.abc import Iterable
from dataclasses import replace
from importlib import resources
from pathlib import Path
from typing import Any

from sysid import __version__
from sysid.blocks.numbers import MINUS, number, unit
from sysid.blocks.sections import Block
from sysid.blocks.standing import drawn
from sysid.errors import escaped

_TEMPLATES = resources.files("sysid.blocks") / "templates"


def fill(template: str, *, folder: Path | None = None, **content: Any) -> str:
    """The page of a template that extends `frame.html`, the report's own or one in `folder`.

    `content` is what the template uses; texts in it are escaped, and figures drawn.
    """
    from markupsafe import Markup

    environment = _environment(folder)
    sections = [replace(s, blocks=drawn(s.blocks)) for s in content.pop("sections", ())]
    page: str = environment.get_template(template).render(
        **content,
        sections=sections,
        version=__version__,
        written=moment(datetime.datetime.now(datetime.UTC)),
        style=Markup(template_text("style.css") + template_text("phone.css")),
    )
    return page


_ORIGIN = re.compile(r'<meta name="sysid-fit" content="([^"]*)">')


def origin_text(fitted_on: Iterable[tuple[str, str]]) -> str:
    """Kind and SHA-256 of a page's training logs, as its head holds them for `origin_of`."""
    return " ".join(f"{kind}:{digest}" for kind, digest in sorted(fitted_on))


def origin_of(page: str) -> frozenset[tuple[str, str]] | None:
    """Kind and SHA-256 of each log that a page's bundle was fitted on; None for another page."""
    found = _ORIGIN.search(page)
    if found is None:
        return None
    pairs = (word.rpartition(":") for word in found[1].split())
    return frozenset((kind, digest) for kind, _, digest in pairs)


@functools.cache
def _block_template() -> Any:
    """The template of one block without its page."""
    text = '{% import "macros.html" as macros %}{{ macros.block(b) }}'
    return _environment().from_string(text)


def block_html(block: Block) -> str:
    """A block without figures as markup, as it is in a page."""
    return str(_block_template().render(b=block))


def _readable(value: Any) -> Any:
    """A text without the control characters that a file's names and labels may hold."""
    return escaped(value, keep="\n\t") if isinstance(value, str) else value


# A number as messages have it: with a power of ten, or below zero after a space or a bracket.
_ASCII = re.compile(r"(?<![\w.+-])-?\d+(?:\.\d+)?e[+-]\d+\b|(?<=[\s(])-(?=\d)")
_SQUARE = re.compile(r"(?<=\w)\^([23])(?![\w.])")
# A unit behind a number, as bundles and users' components have it.
_UNIT = re.compile(
    r"(?<=\d )(?:Nm\b(?: s/rad)?|ohm\b|[A-Za-z]+(?:\*\*[23]|[*/](?=[A-Za-z])[A-Za-z]+)+)"
)
_BACKTICKS = re.compile("`([^`]+)`")


def typeset(line: str) -> str:
    """A message with the signs that a page has: minus, times, and those of units."""
    line = _UNIT.sub(lambda m: unit(m[0]), line)
    line = _SQUARE.sub(lambda m: "²³"[int(m[1]) - 2], line)
    return _ASCII.sub(lambda m: MINUS if m[0] == "-" else _power_of_ten(m[0]), line)


def coded(line: str) -> Any:
    """A text as markup, what is in backticks as code."""
    from markupsafe import Markup, escape

    return Markup(_BACKTICKS.sub(r"<code>\1</code>", str(escape(escaped(line, keep="\n\t")))))


def _in_text(line: str) -> Any:
    return coded(typeset(line))


def _power_of_ten(text: str) -> str:
    mantissa = text.lstrip("-").partition("e")[0]
    return number(float(text), len(mantissa.replace(".", "")))


def moment(time: datetime.datetime) -> str:
    """A time to the minute, UTC."""
    return time.astimezone(datetime.UTC).strftime("%Y-%m-%d %H:%M UTC")


def template_text(name: str) -> str:
    """A file of the report's templates, unchanged."""
    return (_TEMPLATES / name).read_text("utf-8")


def _environment(folder: Path | None = None) -> Any:
    """What templates are rendered by: those of this room, and those in a folder."""
    import jinja2
    from markupsafe import Markup

    loaders: list[jinja2.BaseLoader] = [jinja2.FunctionLoader(_source)]
    if folder is not None:
        loaders.append(jinja2.FileSystemLoader(folder))
    environment = jinja2.Environment(
        loader=jinja2.ChoiceLoader(loaders),
        autoescape=True,
        trim_blocks=True,
        lstrip_blocks=True,
        undefined=jinja2.StrictUndefined,
        finalize=lambda value: value if isinstance(value, Markup) else _readable(value),
    )
    environment.filters["typeset"] = _in_text
    environment.filters["longest_word"] = lambda text: max(map(len, text.split()), default=0)
    return environment


def _source(name: str) -> str | None:
    return template_text(name) if (_TEMPLATES / name).is_file() else None


__all__ = [
    "block_html",
    "coded",
    "fill",
    "moment",
    "origin_of",
    "origin_text",
    "template_text",
    "typeset",
]
