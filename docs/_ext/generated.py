"""Pages of the reference that are written from the code, into `docs/reference/generated/`.

A page is written only where its content differs, so that an unchanged one is not built again.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import effect_pages
import equation_pages
import figure_pages
import format_pages
import message_pages

from sysid.commands.app import COMMANDS, home_of


def write(path: Path, content: str | bytes) -> None:
    """Write a file where its content differs."""
    data = content.encode("utf-8") if isinstance(content, str) else content
    path.parent.mkdir(parents=True, exist_ok=True)
    if not path.exists() or path.read_bytes() != data:
        path.write_bytes(data)


def command_line() -> str:
    """The help of every command."""
    parts = ["# Command line\n\nEvery command, from the program's own declarations.\n"]
    for name in COMMANDS:
        parts.append(
            f"```{{eval-rst}}\n.. click:: sysid.commands.{home_of(name)}:{home_of(name)}\n"
            f"   :prog: sysid {name}\n```\n"
        )
    return "\n".join(parts)


INCLUDED: dict[str, Callable[[], str]] = {
    "command-line.md": command_line,
    "log-columns.md": format_pages.log_columns,
    "rig-file.md": format_pages.rig_file,
    "campaign-file.md": format_pages.campaign_file,
    "bundle.md": format_pages.bundle,
    "messages.md": message_pages.messages,
    "equations.md": equation_pages.equations,
}
"""Files that pages of the reference include, and what writes them."""


def generate(app: Any) -> None:
    """Write all pages."""
    folder = Path(app.srcdir) / "reference" / "generated"
    cache = Path(app.outdir).parent / "docs-pictures"
    for name, page in INCLUDED.items():
        write(folder / name, page())
    for name, content in figure_pages.pages().items():
        write(folder / name, content)
    for name, content in effect_pages.pages(cache).items():
        write(folder / name, content)


def setup(app: Any) -> dict[str, bool]:
    """Sphinx' entry."""
    app.connect("builder-inited", generate)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
