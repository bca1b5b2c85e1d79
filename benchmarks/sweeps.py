"""Sweeps over drawn rigs that go on where they ended: one line of JSON a seed."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any


def accumulated(
    path: Path, seeds: tuple[int, int], one: Callable[[int], dict[str, Any]]
) -> list[dict[str, Any]]:
    """The results of a file, with those of the seeds (first, end) that it lacks, each kept at once.

    `one(seed)` gives a result, which holds its `seed`.
    """
    lines = path.read_text().splitlines() if path.exists() else []
    results = [json.loads(line) for line in lines]
    known = {r["seed"] for r in results}
    for seed in range(*seeds):
        if seed not in known:
            results.append(one(seed))
            with path.open("a") as file:
                file.write(json.dumps(results[-1]) + "\n")
    return results
