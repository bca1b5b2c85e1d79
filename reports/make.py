"""Regenerate the example report and its pictures: `make reports` calls this.

    python reports/make.py

`model.png` is the first picture of the report: a held-out test, before and after. That of the first
screen is not changed, with a notice, if Chromium is not installed.
"""

from __future__ import annotations

import json
import shutil
import sys
import tempfile
from dataclasses import replace
from pathlib import Path

from sysid.blocks.figures import Figure

HERE = Path(__file__).resolve().parent
CHROMIUM_OPTIONS = [
    "--no-sandbox",
    "--disable-gpu",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
]


def picture(page: Path, target: Path) -> None:
    """The first screen of a report as a PNG, taken in headless Chromium."""
    from playwright.sync_api import sync_playwright

    chromium = shutil.which("chromium")
    if chromium is None:
        print("chromium is not installed: the picture is not regenerated", file=sys.stderr)
        return
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=chromium, args=CHROMIUM_OPTIONS)
        view = browser.new_page(viewport={"width": 1180, "height": 820})
        view.goto(page.as_uri())
        view.wait_for_load_state("networkidle")
        view.screenshot(path=str(target))
        browser.close()


def model_picture(diagnosis: Path, target: Path) -> None:
    """The held-out test of a diagnosis as a PNG."""
    import matplotlib

    matplotlib.use("agg")
    from matplotlib import pyplot

    from sysid.blocks.drawing import draw
    from sysid.pipeline.pages.held_out import first_picture

    shown = first_picture(None, json.loads(diagnosis.read_text("utf-8")), False)
    if shown is None or not isinstance(shown.figures[0], Figure):
        raise SystemExit("the diagnosis holds no held-out test")
    panels = shown.figures[0].panels
    heights = [panel.height for panel in panels]
    figure, axes = pyplot.subplots(
        len(panels), sharex=True, figsize=(8.0, 4.2), height_ratios=heights, layout="constrained"
    )
    for ax, panel in zip(axes, panels, strict=True):
        draw(ax, replace(panel, legend="over") if panel.legend == "above" else panel)
        ax.spines[["top", "right"]].set_visible(False)
        ax.grid(alpha=0.3)
    axes[0].set_xlabel("")
    figure.align_ylabels()
    figure.savefig(target, dpi=130)


def main() -> None:
    """Run the bundled campaign and keep its report."""
    from sysid.io.bundled import bundled_campaign
    from sysid.pipeline.run import run_campaign

    with tempfile.TemporaryDirectory() as folder:
        done = run_campaign(bundled_campaign(), Path(folder), advise=True, progress=print)
        shutil.copyfile(done.report, HERE / "example.html")
        model_picture(Path(folder) / "diagnosis.json", HERE / "model.png")
    picture(HERE / "example.html", HERE / "example.png")


if __name__ == "__main__":
    main()
