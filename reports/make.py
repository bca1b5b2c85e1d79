"""Regenerate the example report and its picture: `make reports` calls this.

    python reports/make.py

The picture is not changed, with a notice, if Chromium is not installed.
"""

from __future__ import annotations

import shutil
import sys
import tempfile
from pathlib import Path

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


def main() -> None:
    """Run the bundled campaign and keep its report."""
    from sysid.io.bundled import bundled_campaign
    from sysid.pipeline.run import run_campaign

    with tempfile.TemporaryDirectory() as folder:
        done = run_campaign(bundled_campaign(), Path(folder), progress=print)
        shutil.copyfile(done.report, HERE / "example.html")
    picture(HERE / "example.html", HERE / "example.png")


if __name__ == "__main__":
    main()
