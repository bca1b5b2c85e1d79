"""The required figures as pages, one a subject, from `benchmarks/figures.jsonl`."""

from __future__ import annotations

from benchmarks.figures import SUBJECTS, of_subject, read, table

_INDEX = """# Figures

Every figure that this project claims, with what was asked and the command that measures it, from
`benchmarks/figures.jsonl`; of {count}, {missed} are not reached. Unless a row says otherwise the
machine has two cores; a speed is a ratio of two whole processes that run in turn.

| subject | figures | missed |
| --- | --- | --- |
{rows}

```{{toctree}}
:hidden:

{pages}
```
"""


def pages() -> dict[str, str]:
    """Page text by file name, the index among them."""
    rows = read()
    found: dict[str, str] = {}
    lines = []
    for subject, title in SUBJECTS.items():
        own = of_subject(rows, subject)
        missed = sum(row.reached is False for row in own)
        found[f"figures/{subject}.md"] = f"# {title}\n\n{table(own)}"
        lines.append(f"| [{title}]({subject}.md) | {len(own)} | {missed or ''} |")
    found["figures/index.md"] = _INDEX.format(
        count=len(rows),
        missed=sum(row.reached is False for row in rows),
        rows="\n".join(lines),
        pages="\n".join(SUBJECTS),
    )
    return found
