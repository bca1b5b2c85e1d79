"""The workbench in the browser: who gets in, its screens in Chromium, changes and jobs."""

from __future__ import annotations

import asyncio
import http.client
import json
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from golden_folder import golden_bundle
from small_campaign import write_small

pytest.importorskip("panel", reason="panel is absent")

from sysid.app import edits
from sysid.app.jobs import Job
from sysid.app.journal import FileChange, Journal
from sysid.app.page import Window as PageWindow
from sysid.app.screens.compare import CompareContent, CompareScreen
from sysid.app.screens.effects import EffectsScreen, _gains
from sysid.app.screens.export import ExportScreen, written_by
from sysid.app.screens.files import FilesScreen
from sysid.app.screens.fit import FitScreen
from sysid.app.screens.identify import IdentifyScreen
from sysid.app.screens.mapping import Assigned, Mapping, plausibility
from sysid.app.server import Gate
from sysid.app.traces import BUCKETS, Curve, TracePanel, TraceView
from sysid.app.workbench import StepMissingError, Workbench
from sysid.blocks.figures import ColourMap, Figure, Panel, Scale
from sysid.blocks.interactive import draw
from sysid.blocks.sections import Section
from sysid.errors import InputError
from sysid.io.campaign import read_campaign
from sysid.io.listing import channels_of
from sysid.io.plausibility import give_map, with_maps
from sysid.parameters import read_bundle
from sysid.pipeline.compare import compare
from sysid.pipeline.diagnosed import read_diagnosis
from sysid.plant.effects.catalogue import catalogue

REPOSITORY = Path(__file__).resolve().parent.parent
_TEXT_OF = """(place) => {
  const collect = (node) => {
    if (node.nodeType === Node.TEXT_NODE) return node.data + " ";
    if (["STYLE", "SCRIPT", "LINK"].includes(node.nodeName)) return "";
    const inner = node.shadowRoot ? [...node.shadowRoot.childNodes] : [];
    return [...inner, ...node.childNodes].map(collect).join("");
  };
  return collect(document.querySelector(place)).replace(/\\s+/g, " ");
}"""
_BOXES_OF = """(names) => {
  const find = (root, name) => {
    for (const node of root.querySelectorAll("*")) {
      if (node.classList.contains(name)) return node;
      const inner = node.shadowRoot && find(node.shadowRoot, name);
      if (inner) return inner;
    }
  };
  return names.map((name) => find(document.querySelector("#main"), name))
    .map((node) => node ? node.getBoundingClientRect().toJSON() : null);
}"""
WAIT_MS = 150_000


@dataclass
class Server:
    """A `sysid app` in a process of its own."""

    folder: Path
    process: Any = None
    address: str = ""

    def start(self) -> Server:
        """Start it, and wait until the workbench is at its address."""
        self.begin()
        pair = f"sysid-app-{self.port}={self.token}"
        wait_until(lambda: self.ask("/alive", Cookie=pair).status == 200)
        return self

    def begin(self, before: str = "") -> Server:
        """Start it, after the lines of Python `before`, and wait for its address alone."""
        main = "from sysid.commands.app import main; sys.exit(main())"
        words = ["app", "campaign.toml", "--no-browser"]
        with (self.folder / "server.err").open("w") as said:
            self.process = subprocess.Popen(
                [sys.executable, "-c", f"import sys\n{before}\n{main}", *words],
                cwd=self.folder,
                stdout=subprocess.PIPE,
                stderr=said,
                text=True,
            )
        for line in self.process.stdout:
            found = re.search(r"http://\S+", line)
            if found:
                self.address = found[0]
                return self
        raise AssertionError((self.folder / "server.err").read_text("utf-8"))

    @property
    def port(self) -> int:
        return int(re.findall(r":(\d+)/", self.address)[0])

    @property
    def token(self) -> str:
        return self.address.partition("token=")[2]

    def ask(self, path: str, method: str = "GET", body: bytes = b"", **headers: str) -> Any:
        """A request; the answer with its body read."""
        given = {name.replace("_", "-"): value for name, value in headers.items()}
        connection = http.client.HTTPConnection("127.0.0.1", self.port, timeout=30)
        connection.request(method, path, body or None, given)
        answer = connection.getresponse()
        answer.text = answer.read().decode("utf-8", "replace")  # type: ignore[attr-defined]
        connection.close()
        return answer

    def kill(self, number: int = signal.SIGKILL) -> int:
        """End it, by default without a chance to say anything."""
        self.process.send_signal(number)
        code = self.process.wait(120)
        self.process.stdout.close()
        return int(code)


_BACKGROUND = "(node) => getComputedStyle(node).backgroundColor"


def wait_until(holds: Callable[[], bool]) -> None:
    """Until something holds; an assertion that it does after a while."""
    until = time.monotonic() + WAIT_MS / 1000.0
    while not holds():  # asked once each time: a page that is drawn anew may lack it again
        assert time.monotonic() < until
        time.sleep(0.05)


def started(folder: Path) -> Server:
    """The workbench on a small campaign in an empty folder, with a fitted model."""
    write_small(folder)
    (folder / "results").mkdir()
    shutil.copy(
        REPOSITORY / "datasets/thesis/reference_bundle.json", folder / "results/fitted.json"
    )
    return Server(folder).start()


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Server]:
    running = started(tmp_path_factory.mktemp("app"))
    yield running
    running.kill()


@dataclass
class Page:
    """A window, and what it complained about."""

    server: Server
    page: Any
    faults: list[str] = field(default_factory=list)

    def open(self) -> Page:
        self.page.set_default_timeout(WAIT_MS)
        self.page.on("pageerror", lambda error: self.faults.append(str(error)))
        self.page.on("request", self._asked)
        self.page.goto(self.server.address)
        self.page.wait_for_selector("h2")
        return self

    def _asked(self, request: Any) -> None:
        if not request.url.startswith((f"http://127.0.0.1:{self.server.port}/", "data:", "blob:")):
            self.faults.append(f"asked for {request.url}")

    def show(self, key: str) -> None:
        """Go to a screen by its key."""
        self.page.locator("#main").focus()
        self.page.keyboard.press(key)
        self.page.wait_for_function(
            "(key) => { const find = (root) => { for (const n of root.querySelectorAll('*')) {"
            " if (n.matches('button.tab.on')) return n.dataset.value;"
            " if (n.shadowRoot) { const f = find(n.shadowRoot); if (f) return f; } } };"
            " return find(document) === key; }",
            arg=key,
        )
        self.page.locator(".wait").wait_for(state="detached")
        self.page.locator("#main h2").first.wait_for()

    def text(self, place: str) -> str:
        """The text of a part of the page, that in shadow roots too."""
        return str(self.page.evaluate(_TEXT_OF, place))

    def boxes(self, *classes: str) -> list[dict[str, float]]:
        """Where the first element of each class is, all at one moment.

        A page may be drawn anew between two questions, which leaves the second without its element.
        """
        found: list[dict[str, float] | None] = []

        def all_there() -> bool:
            found[:] = self.page.evaluate(_BOXES_OF, list(classes))
            return all(found)

        wait_until(all_there)
        return [box for box in found if box]

    def lacking(self, wanted: Sequence[str]) -> list[str]:
        """Which of these texts the screen does not show."""
        text = self.text("#main")
        return [one for one in wanted if one not in text]

    def say(self, kind: str) -> str:
        """The message at the top, once there is one."""
        message = self.page.locator(f"div.{kind}").first
        message.wait_for()
        return str(message.inner_text())


@pytest.fixture(scope="module")
def window(server: Server, browser: Any) -> Page:
    context = browser.new_context(viewport={"width": 1400, "height": 900}, color_scheme="light")
    return Page(server, context.new_page()).open()


# --- who gets in ----------------------------------------------------------------------------


def test_only_the_token_lets_in(server: Server) -> None:
    host = f"127.0.0.1:{server.port}"
    for path in ("/", "/workbench", "/style.css", "/files/campaign.toml", "/workbench/ws"):
        assert server.ask(path).status == 403
        assert server.ask(f"{path}?token=wrong").status == 403
    entered = server.ask(f"/?token={server.token}")
    cookie = entered.headers["Set-Cookie"]
    assert entered.status == 200
    assert "HttpOnly" in cookie and "SameSite=Strict" in cookie
    pair = cookie.partition(";")[0]
    assert server.ask("/style.css", Cookie=pair).status == 200
    assert server.ask("/style.css", Cookie=pair, Origin="http://evil.example").status == 403
    assert server.ask("/style.css", Cookie=pair, Origin=f"http://{host}").status == 200
    assert server.ask("/style.css", Cookie=pair, Host="evil.example").status == 403
    assert server.ask("/style.css", Cookie=pair, Sec_Fetch_Site="cross-site").status == 403


def test_a_websocket_passes_the_same_gate(server: Server) -> None:
    asked = {
        "Upgrade": "websocket", "Connection": "Upgrade", "Sec_WebSocket_Version": "13",
        "Sec_WebSocket_Key": "c3lzaWQgd29ya2JlbmNoIQ==",
    }  # fmt: skip
    pair = f"sysid-app-{server.port}={server.token}"
    assert server.ask("/workbench/ws", **asked).status == 403
    other = server.ask("/workbench/ws", Cookie=pair, Origin="http://evil.example", **asked)
    assert other.status == 403


def test_it_listens_on_this_machine_alone(server: Server) -> None:
    listening = Path("/proc/net/tcp")
    if not listening.exists():
        pytest.skip("/proc/net/tcp is absent")
    lines = [line.split() for line in listening.read_text().splitlines()[1:]]
    wanted = f":{server.port:04X}"
    addresses = {w[1] for w in lines if w[1].endswith(wanted) and w[3] == "0A"}
    assert addresses == {f"0100007F{wanted}"}


def test_files_of_the_folder_alone_are_given(server: Server) -> None:
    pair = f"sysid-app-{server.port}={server.token}"
    (server.folder / "page.html").write_text("<p>one</p>", "utf-8")
    given = server.ask("/files/page.html", Cookie=pair)
    assert given.status == 200 and "sandbox" in given.headers["Content-Security-Policy"]
    for path in ("/files/rig.toml", "/files/../../etc/passwd", "/files/%2e%2e/%2e%2e/etc/hosts"):
        assert server.ask(path, Cookie=pair).status == 404


def test_an_upload_is_bounded_and_replaces_nothing(server: Server) -> None:
    pair = f"sysid-app-{server.port}={server.token}"
    before = (server.folder / "motion_discrete.parquet").read_bytes()
    sent = server.ask("/upload/motion_discrete.parquet", "PUT", b"other", Cookie=pair)
    assert (sent.status, sent.text) == (200, "motion_discrete-2.parquet")
    assert (server.folder / "motion_discrete.parquet").read_bytes() == before
    (server.folder / sent.text).unlink()
    for name in ("..%2fevil.csv", ".hidden", "own.py", "campaign.toml"):
        refused = server.ask(f"/upload/{name}", "PUT", b"x", Cookie=pair)
        assert refused.status == 400 or refused.text == "evil.csv"
    assert not (server.folder.parent / "evil.csv").exists()
    (server.folder / "evil.csv").unlink(missing_ok=True)
    many = {"Cookie": pair, "Content_Length": str(10**13)}
    assert server.ask("/upload/long.csv", "PUT", b"", **many).status == 400
    assert not list(server.folder.glob(".sysid-*.tmp"))


# A module whose import takes as long as a file is absent, as on a machine that reads slowly.
SLOW = """\
import os, time
class Slow:
    def find_spec(self, name, path=None, target=None):
        while name == {name!r} and not os.path.exists("go on"):
            time.sleep(0.01)
sys.meta_path.insert(0, Slow())
"""


def test_the_address_answers_before_the_workbench_is_imported(tmp_path: Path, browser: Any) -> None:
    write_small(tmp_path)
    server = Server(tmp_path).begin(SLOW.format(name="bokeh"))
    pair = f"sysid-app-{server.port}={server.token}"
    assert server.ask("/alive", Cookie=pair).status == 503
    assert server.ask("/workbench").status == server.ask("/?token=wrong").status == 403
    page = browser.new_page()
    page.set_default_timeout(WAIT_MS)
    page.goto(server.address)
    page.get_by_text("The workbench is starting").wait_for()
    (tmp_path / "go on").touch()
    page.get_by_text("Recordings").wait_for()  # it goes on by itself
    page.close()
    assert server.kill(signal.SIGINT) == 0


def test_what_it_does_is_printed_before_anything_slow(tmp_path: Path) -> None:
    write_small(tmp_path)
    main = "from sysid.commands.app import main; sys.exit(main())"
    with subprocess.Popen(
        [sys.executable, "-c", f"import sys\n{SLOW.format(name='numpy')}\n{main}",
         "app", "campaign.toml", "--no-browser"],
        cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    ) as started:  # fmt: skip
        assert started.stderr.readline() == "sysid app: reading campaign.toml\n"
        started.kill()


# --- screens --------------------------------------------------------------------------------

SHOWN = {
    "1": ("Recordings", "friction_sliding.parquet", "[cylinder]", "pitch_radius_m"),
    "2": ("Tests", "friction_static", "Exclude the whole test", "training"),
    "3": ("not identified", "static friction", "friction_sliding", "Which test to run next"),
    "4": ("Run everything", "results/fitted.json", "Friction parameters"),
    "5": ("Measured less simulated", "RMSE", "motion_discrete.parquet, test 1"),
    "6": ("Run the diagnosis", "Stribeck", "Choose an effect"),
    "7": ("Compare", "Choose two bundles"),
    "8": ("C header", "flat JSON", "results/fitted.json"),
}


@pytest.mark.parametrize("key", SHOWN)
def test_a_screen_shows_its_content(key: str, window: Page) -> None:
    window.show(key)
    wait_until(lambda: set(window.lacking(SHOWN[key])) == set())
    assert window.faults == []


def test_a_screen_before_its_step_leads_to_that_step(tmp_path: Path) -> None:
    bench = Workbench(tmp_path, tmp_path / "campaign.toml", tmp_path / "results")
    screens = {"files": FilesScreen, "fit": FitScreen, "export": ExportScreen}
    host = SimpleNamespace(bench=bench, scheme="light")
    page = SimpleNamespace(bench=bench, screens={k: made(host) for k, made in screens.items()})
    for key, lacking, goes_to in (("fit", "No campaign yet", 1), ("export", "Nothing was", 2)):
        with pytest.raises(StepMissingError) as missing:
            page.screens[key].read()
        text = PageWindow._lacking(page, page.screens[key], missing.value)
        assert lacking in text and f'data-do="screen" data-value="{goes_to}"' in text


def test_a_list_of_effects_has_no_empty_columns(tmp_path: Path) -> None:
    bench = Workbench(tmp_path, tmp_path / "campaign.toml", tmp_path / "results")
    screen = EffectsScreen(SimpleNamespace(bench=bench, scheme="light"))
    known = {"stribeck-friction": catalogue()["stribeck-friction"]}
    look = {"suspects": [{"id": "stribeck-friction", "gain": 3.0, "p_value": 0.02}]}
    found = {"effects": [{"id": "stribeck-friction"}], "figures": {"looks": [look]}}
    for diagnosis, heads in ((None, 1), ({**found, "effects": []}, 3), (found, 3)):
        content = SimpleNamespace(known=known, diagnosis=diagnosis)
        text = screen._list(content)
        assert text.count('scope="col"') == heads
        # Next to the name: a column at the end is off the edge of a phone.
        assert ("Stribeck friction <b>(found)</b>" in text) == (diagnosis is found)


def test_the_verdict_is_said_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    bench = Workbench(tmp_path, tmp_path / "campaign.toml", tmp_path / "results")
    screen = EffectsScreen(SimpleNamespace(bench=bench, scheme="light"))
    placed: list[Section] = []
    monkeypatch.setattr(screen, "section_place", placed.append)
    section = Section("diagnosis", "Diagnosis", ("One effect is missing.",), ())
    common = {"tests": (), "known": {}, "diagnosis": None, "why": ""}
    screen.draw(SimpleNamespace(section=section, **common))
    assert "One effect is missing." in screen.head.object
    assert [(s.id, s.intro) for s in placed] == [("diagnosis", ())]


def test_evidence_is_that_next_to_what_was_found() -> None:
    def suspect(id: str, gain: float, twins: float, p_value: float) -> dict[str, Any]:
        return {"id": id, "gain": gain, "twins": [twins], "p_value": p_value}

    first = [suspect("found", 300.0, 4.0, 1e-60), suspect("other", 46.0, 72.0, 1.0)]
    second = [suspect("found", 1.0, 2.0, 1.0), suspect("other", 31.0, 0.0, 1e-4)]
    rounds = [{"added": "found", "suspects": first}, {"added": None, "suspects": second}]
    evidence = _gains({"figures": {"looks": rounds}})
    assert evidence == {"found": (296.0, 1e-60), "other": (31.0, 1e-4)}


def test_tables_on_a_phone_are_those_of_reports(server: Server, browser: Any) -> None:
    context = browser.new_context(viewport={"width": 390, "height": 900})
    page = Page(server, context.new_page()).open()
    page.show("4")
    name = page.page.locator("table.long tbody th").first
    assert name.evaluate("(node) => getComputedStyle(node).position") == "sticky"
    assert page.page.evaluate("document.documentElement.scrollWidth") <= 390
    page.show("3")  # its menu has long texts
    page.page.locator("select[data-do=identify-for]").wait_for()
    assert page.page.evaluate("document.documentElement.scrollWidth") <= 390
    page.show("1")
    remove = page.page.locator("button[data-do^=log-remove]")
    wait_until(lambda: remove.count() > 0)
    ends = remove.evaluate_all("(all) => all.map((one) => one.getBoundingClientRect().right)")
    assert max(ends) <= 390
    context.close()


def test_a_file_that_is_no_log_is_one_line(window: Page) -> None:
    (window.server.folder / "photo.csv").write_bytes(b"\x89PNG\r\n\x1a\n" + bytes(range(256)) * 20)
    window.show("1")
    window.page.locator("select[data-do=file]").wait_for()
    window.page.reload()
    window.page.wait_for_selector("h2")
    window.page.locator("select[data-do=file]").select_option("photo.csv")
    assert "photo.csv: is" in window.say("error")
    assert window.faults == []


def test_two_windows_on_one_campaign(window: Page) -> None:
    path = window.server.folder / "campaign.toml"
    before = path.read_text("utf-8")
    other = Page(window.server, window.page.context.new_page()).open()
    window.show("2")
    other.show("2")
    window.page.locator("input[data-do=look-why]").fill("cable torn")
    window.page.locator("input[data-do=look-why]").press("Tab")
    window.page.locator("button[data-do=look-exclude-test]").click()
    other.page.get_by_text("excluded: test 1: cable torn").wait_for()
    assert read_campaign(path).logs[0].exclude[0].why == "cable torn"
    # Nothing is left of it to exclude once more.
    window.page.locator("button[data-do=look-exclude-test][disabled]").wait_for()
    wait_until(lambda: 'why = "cable torn"' in window.text(".done"))
    other.page.locator("#main").focus()
    other.page.keyboard.press("z")
    window.page.locator("#main").get_by_text("cable torn").wait_for(state="detached")
    wait_until(lambda: path.read_text("utf-8") == before)
    other.page.close()


def test_a_labs_file_becomes_a_log(window: Page) -> None:
    folder = window.server.folder
    time_ms = np.arange(3000)
    angle = np.degrees(0.4 * np.sin(time_ms / 300.0))
    lines = [
        f"{t};{a:.6f};{2.0 * np.sin(t / 300.0):.5f}" for t, a in zip(time_ms, angle, strict=True)
    ]
    (folder / "lab.csv").write_text("\n".join(["clock;angle;drive", *lines]), "utf-8")
    kept = (folder / "campaign.toml").read_text("utf-8")
    window.page.reload()
    window.show("1")
    page = window.page
    page.locator("select[data-do=file]").select_option("lab.csv")
    for place, target, unit in (
        (0, "time_s", "ms"),
        (1, "theta_rad", "deg"),
        (2, "motor_volts", "V"),
    ):
        page.locator(f"select[data-do='map:{place}:target']").select_option(target)
        page.locator(f"input[data-do='map:{place}:unit']").fill(unit)
    page.locator("input[data-do='map:2:unit']").press("Enter")
    row = page.locator("tr", has=page.locator("select[data-do='map:2:target']"))
    chosen = row.locator("td").first.evaluate(_BACKGROUND)
    page.locator("select[data-do='map:2:target']").select_option("")
    assert row.locator("td").first.evaluate(_BACKGROUND) != chosen  # what a channel is stands out
    page.locator("select[data-do='map:2:target']").select_option("motor_volts")
    wait_until(lambda: "3,000 rows, 2.999 s, every 0.001 s" in window.text("#main"))
    # A first guess of the kind follows the channels, until a person has said it.
    wait_until(lambda: page.locator("select[data-do=add-kind]").input_value() == "friction-motion")
    page.locator("select[data-do=add-kind]").select_option("motion-motor")
    page.locator("input[data-do='map:2:unit']").fill("furlong")
    page.locator("input[data-do='map:2:unit']").press("Enter")
    page.locator("button[data-do=add][disabled]").wait_for()
    page.get_by_text("furlong").first.wait_for()
    page.locator("input[data-do='map:2:unit']").fill("V")
    page.locator("input[data-do='map:2:unit']").press("Enter")
    page.locator("button[data-do=add]:not([disabled])").click()
    wait_until(lambda: 'file = "motion_motor.csv"' in (folder / "campaign.toml").read_text("utf-8"))
    assert "--map time_s=clock:ms" in window.text(".strip")
    log = read_campaign(folder / "campaign.toml").read(
        read_campaign(folder / "campaign.toml").logs[-1]
    )
    assert log.trials[0]["theta_rad"] == pytest.approx(np.radians(angle), abs=1e-7)
    page.locator("button[data-do=undo]").click()
    wait_until(lambda: (folder / "campaign.toml").read_text("utf-8") == kept)
    assert window.faults == []


def test_a_tick_with_shift_ticks_all_between(window: Page) -> None:
    folder = window.server.folder
    names = [scope_file(folder, f"tek{i:02}CH.csv").name for i in range(5)]
    window.page.reload()
    window.show("1")
    window.page.locator("select[data-do=file]").select_option(names[0])
    window.page.locator("label", has_text=names[1]).click()
    window.page.locator("label", has_text=names[3]).click(modifiers=["Shift"])
    ticked = window.page.locator("[data-span] input:checked")
    wait_until(lambda: ticked.count() == 3)
    window.page.locator("button[data-do='also-all:0']").click()
    wait_until(lambda: ticked.count() == 4)
    window.page.locator("button[data-do=close-file]").click()
    for name in names:
        (folder / name).unlink()
    assert window.faults == []


def test_a_page_that_is_drawn_anew_keeps_what_is_being_typed(window: Page) -> None:
    rig = window.server.folder / "rig.toml"
    kept = rig.read_text("utf-8")
    window.show("1")
    keyboard = window.page.keyboard
    window.page.locator("input[data-do='rig:cylinder:pitch_radius_m']").click()
    # The first value is written while the second is typed, which draws the form anew; a digit or a
    # "z" that missed its field would show another screen, or undo.
    for text in ("0.025123456", "0.0187654321"):
        keyboard.press("ControlOrMeta+a")
        keyboard.type(text, delay=150)
        keyboard.press("Tab")
    given = ("pitch_radius_m = 0.025123456\n", "equivalent_kg_m2 = 0.0187654321\n")
    wait_until(lambda: all(line in rig.read_text("utf-8") for line in given))
    assert window.lacking(("Recordings", "pitch_radius_m")) == []
    window.page.locator("#main").focus()
    for _ in range(2):
        keyboard.press("z")
    wait_until(lambda: rig.read_text("utf-8") == kept)
    assert window.faults == []


def test_an_effect_is_tried(window: Page) -> None:
    window.show("6")
    page = window.page
    page.locator("button[data-do='fx-choose:torque-offset']").click()
    wait_until(lambda: "RMSE without" in window.text("#main"))
    before = window.text("#main")
    page.locator("input[data-do='fx-set:0']").press("End")
    wait_until(lambda: window.text("#main") != before)
    assert page.locator("button[data-do=fx-held-out]").is_disabled()
    page.locator("button[data-do=fx-freeze]").click()
    page.locator("button[data-do=fx-held-out]:not([disabled])").click()
    wait_until(lambda: "looked at: once" in window.text("#main"))
    found = json.loads((window.server.folder / "results/explored.json").read_text("utf-8"))
    assert [(e["id"], e["chosen_by"]) for e in found["effects"]] == [("torque-offset", "user")]
    assert found["provenance"]["options"]["exploration"]["held_out_looks"] == 1
    assert window.faults == []


def test_a_job_is_cancelled_in_the_page(window: Page) -> None:
    window.show("4")
    window.page.locator("button[data-do=fit-run]").click()
    window.page.locator("button[data-do=cancel]").click()
    wait_until(lambda: "cancelled; nothing was left half-written" in window.text(".strip"))
    assert "sysid run campaign.toml -o results" in window.text(".done")
    assert not list((window.server.folder / "results").glob("**/.sysid-*.tmp"))


@pytest.mark.parametrize("key", ["2", "6"])
def test_what_is_chosen_from_a_list_is_next_to_it(key: str, window: Page) -> None:
    window.show(key)
    side, wide = window.boxes("side", "wide")
    assert side["x"] + side["width"] <= wide["x"]
    assert abs(side["y"] - wide["y"]) < 60.0
    rows = window.page.locator(".side .scroll").first
    assert rows.evaluate("(node) => node.scrollWidth <= node.clientWidth")  # nothing is cut off


def test_a_narrow_dark_window(server: Server, browser: Any) -> None:
    context = browser.new_context(viewport={"width": 800, "height": 900}, color_scheme="dark")
    page = Page(server, context.new_page()).open()
    page.show("2")
    wide = page.page.evaluate("document.documentElement.scrollWidth")
    colour = page.page.evaluate("getComputedStyle(document.body).backgroundColor")
    tests = page.page.locator(".scroll").first
    assert tests.evaluate("(node) => node.scrollWidth <= node.clientWidth")  # nothing is cut off
    assert wide <= 800
    side, chosen = page.boxes("side", "wide")
    assert side["y"] + side["height"] <= chosen["y"]
    assert colour == "rgb(21, 24, 28)"
    assert page.faults == []
    context.close()


# --- changes --------------------------------------------------------------------------------

CAMPAIGN = """\
# our bench, March
rig = "rig.toml"

[[log]]
kind = "friction-static"   # ramps
file = "a.csv"

[[log]]
kind = "motion-motor"
file = "b.csv"
use = "holdout"
"""


def test_a_change_leaves_the_rest_of_a_file_alone() -> None:
    text = edits.excluded(0, "a.csv", "7", (1.5, 2.0), "hit a stop")(CAMPAIGN)
    (line,) = set(text.splitlines()) - set(CAMPAIGN.splitlines())
    assert line == 'exclude = [{test = "7", from_s = 1.5, to_s = 2.0, why = "hit a stop"}]'
    assert edits.included(0, "a.csv", 0)(text) == CAMPAIGN
    text = edits.log_changed(1, "b.csv", "use", "fit")(CAMPAIGN)
    assert edits.changed_lines(CAMPAIGN, text) == '-use = "holdout"\n+use = "fit"'
    with pytest.raises(InputError, match="has moved meanwhile"):
        edits.log_changed(0, "b.csv", "use", "fit")(CAMPAIGN)


def test_undo_leaves_alone_what_an_editor_changed(tmp_path: Path) -> None:
    (tmp_path / "rig.toml").write_text("a = 2\n", "utf-8")
    Journal.read(tmp_path).made(FileChange("a set", "rig.toml", "a = 1\n", "a = 2\n"))
    journal = Journal.read(tmp_path)  # as after a restart
    assert journal.undo().what == "a set"
    assert (tmp_path / "rig.toml").read_text("utf-8") == "a = 1\n"
    Journal.read(tmp_path).redo()
    (tmp_path / "rig.toml").write_text("a = 3\n", "utf-8")
    with pytest.raises(InputError, match="changed outside the workbench"):
        Journal.read(tmp_path).undo()
    assert (tmp_path / "rig.toml").read_text("utf-8") == "a = 3\n"


def test_a_change_that_cannot_be_read_is_not_made(tmp_path: Path) -> None:
    path = write_small(tmp_path)
    bench = Workbench(tmp_path, path, tmp_path / "results")
    rig = bench.rig_file
    assert rig is not None
    before = rig.read_text("utf-8")
    with pytest.raises(InputError, match=r"rig.toml: \[air\] temperature_k = 25"):
        bench.change(rig, "degrees", edits.constants_set({"air:temperature_k": 25.0}))
    assert rig.read_text("utf-8") == before
    assert not list(tmp_path.glob(".sysid-*"))


@pytest.mark.parametrize(
    ("assigned", "entry"),
    [
        (Assigned("time_s", "ms"), "time_s=t:ms"),
        (Assigned("position_m", is_reversed=True), "position_m=t:-1 m"),
        (Assigned("pressure_a_pa", "bar", is_gauge=True), "pressure_a_pa=t:bar(g)"),
        (
            Assigned("pressure_a_pa", "bar", True, False, ("0.5", "4.5"), ("0", "10")),
            "pressure_a_pa=t:0.5..4.5 -> 0..10 bar(g)",
        ),
    ],
)
def test_what_a_menu_says_is_an_entry_of_map(assigned: Assigned, entry: str) -> None:
    from sysid.io.units import parse_map

    assert assigned.entry("t") == entry
    assert parse_map([entry])[assigned.target].column == "t"


@pytest.mark.parametrize(
    ("column", "unit", "said"),
    [
        ("p [V]", "bar", "pressure_a_pa in bar"),
        ("p: chamber", "kPa(g)", "pressure_a_pa in kPa of a gauge"),
        ("p", "0..101325 -> 101325..0 Pa", "pressure_a_pa in 0..101325 -> 101325..0 Pa"),
        ("p", "1/255", "pressure_a_pa in 1/255"),
    ],
)
def test_an_entry_that_a_message_asks_for_is_known_in_it(column: str, unit: str, said: str) -> None:
    told = f"a.csv: it is in another unit; {give_map('pressure_a_pa', column, unit)}, or fix it"

    def shown(target: str, unit: str, is_gauge: bool) -> str:
        return f"{target} in {unit}{' of a gauge' if is_gauge else ''}"

    assert with_maps(told, shown) == f"a.csv: it is in another unit; {said}, or fix it"


def scope_file(folder: Path, name: str, *, channels: int = 2, offset: float = 0.0) -> Path:
    """A scope's export: a preamble, the time in ms without a unit, a transducer's volts."""
    lines = ["Model,MSO44", "", ",".join(["TIME", *(f"CH{i}" for i in range(1, channels + 1))])]
    for i in range(400):
        cells = [0.6 + 0.2 * np.sin(i / 40.0) + offset] * channels
        lines.append(",".join([f"{i}.0", *(f"{v:.5f}" for v in cells)]))
    (folder / name).write_text("\n".join(lines), "utf-8")
    return folder / name


def opened(path: Path) -> Mapping:
    (listing,) = channels_of([path])
    return Mapping(path, listing)


def test_a_file_says_here_what_the_command_line_would(tmp_path: Path) -> None:
    mapping = opened(scope_file(tmp_path, "fill_1.CSV"))
    mapping.further = [scope_file(tmp_path, "fill_2.CSV").name]
    assert mapping.assigned["TIME"].target == "time_s"  # it counts, but its name says what
    mapping.chosen(0, "unit", "ms")
    mapping.chosen(1, "target", "pressure_a_pa")
    refused = plausibility(mapping, None).text
    assert "--map" not in refused and "sysid-app-" not in refused
    assert (
        "fill_1.CSV: pressure_a_pa runs from" in refused
        and "give the sensor&#x27;s range" in refused
    )
    for key, text in {"r0": "0.5", "r1": "4.5", "v0": "0", "v1": "10", "unit": "bar"}.items():
        mapping.chosen(1, key, text)
    mapping.chosen(1, "is_gauge", True)
    refused = plausibility(mapping, None).text
    assert "CH1: a gauge pressure needs the atmospheric pressure" in refused
    assert "“Atmospheric pressure, for gauge pressures”" in refused and "--" not in refused
    mapping.more["atmosphere_pa"] = "1 bar"
    assert mapping.words("x.csv")[-2:] == ["--atmosphere", "100000"]
    text = plausibility(mapping, None).text
    assert "fill_1.CSV, fill_2.CSV: the table begins in line 3" in text
    assert str(tmp_path) not in text and "--skip-rows" not in text
    assert "sysid init" not in text and "under “Rig” once the log is added" in text


def test_a_channel_is_what_it_was_in_the_last_file(tmp_path: Path) -> None:
    first = opened(scope_file(tmp_path, "fill_1.CSV"))
    first.chosen(1, "target", "pressure_a_pa")
    first.chosen(1, "unit", "bar")
    known = {json.dumps(first.names): first.choices()}
    other = opened(scope_file(tmp_path, "ramp.CSV", channels=3))
    other.follow(known)
    assert other.is_guessed and other.assigned["CH1"] == Assigned("pressure_a_pa", "bar")
    assert other.assigned["CH3"].target == "" and "check it" in other.form()
    same = opened(scope_file(tmp_path, "fill_2.CSV"))
    same.follow(known)
    assert not same.is_guessed and same.choices() == first.choices()


def test_a_log_of_a_series_has_its_name(tmp_path: Path) -> None:
    mapping = opened(scope_file(tmp_path, "fill_1.CSV"))
    assert (mapping.series, mapping.output) == ("fill", "fill_1.csv")
    mapping.further = [scope_file(tmp_path, "fill_2.CSV").name]
    assert mapping.output == "fill.csv"
    (tmp_path / "fill.csv").touch()
    assert mapping.output == "fill-2.csv"
    mapping.further = [scope_file(tmp_path, "ramp.CSV").name]
    assert mapping.output == "fill_1.csv"
    (tmp_path / "fill_1.csv").touch()
    mapping.kind, mapping.valve, mapping.use = "valve-pwm", "a", "holdout"
    assert mapping.output == "valve_pwm_a_holdout.csv"


def test_files_whose_names_differ_in_numbers_are_a_family(tmp_path: Path) -> None:
    names = [f"tek{i:04}CH.csv" for i in (0, 1, 2, 20, 21, 22, 23)]
    others = ["slide 0.3Nm.csv", "slide -0.3Nm.csv", "slide 0.4Nm (2).csv", "ramp.csv"]
    for name in (*names, *others):
        scope_file(tmp_path, name)
    mapping = opened(tmp_path / names[1])
    mapping.alike = tuple(one for one in (*names, *others) if one != names[1])
    assert mapping.families == {
        "3 from tek0000CH to tek0002CH": (names[0], names[2]),
        "all 7 of tek…CH": tuple(one for one in names if one != names[1]),
    }
    slides = opened(tmp_path / others[0])
    slides.alike = (*names, *others[1:])
    assert slides.families == {"all 3 of slide …Nm": (others[1], others[2])}
    ramp = opened(tmp_path / "ramp.csv")
    ramp.alike = mapping.alike
    assert ramp.families == {}
    mapping.tick(2, True, is_span=False)
    mapping.tick(4, True, is_span=True)
    assert mapping.further == names[3:6]
    mapping.tick(3, False, is_span=True)
    assert mapping.further == names[3:4]


def test_what_is_said_of_a_channel_stays_with_its_quantity(tmp_path: Path) -> None:
    first = opened(scope_file(tmp_path, "coil.CSV", channels=3))
    for key, text in {"target": "valve_a", "r0": "0", "r1": "24", "v0": "0", "v1": "1"}.items():
        first.chosen(1, key, text)
    coil = first.assigned["CH1"]
    first.chosen(1, "target", "duty_b")
    assert first.assigned["CH1"] == Assigned("duty_b", readings=("0", "24"), values=("0", "1"))
    first.chosen(1, "target", "motor_volts")  # volts are no duty
    assert first.assigned["CH1"] == Assigned("motor_volts") and not first.is_guessed
    first.chosen(2, "target", "pressure_a_pa")
    first.chosen(2, "unit", "bar")
    first.chosen(3, "target", "pressure_b_pa")  # the other sensor is probably of its kind
    assert first.assigned["CH3"] == Assigned("pressure_b_pa", "bar")
    assert first.is_guessed and "check it" in first.form()
    other = opened(scope_file(tmp_path, "motion.CSV", channels=4))
    first.assigned["CH1"] = coil
    other.follow({}, first.known_with_these([vars(Assigned("theta_rad", "deg"))]))
    other.chosen(4, "target", "duty_a")
    other.chosen(3, "target", "theta_rad")
    assert other.assigned["CH4"] == replace(coil, target="duty_a")
    assert other.assigned["CH3"] == Assigned("theta_rad", "deg")


def test_the_button_that_adds_says_so(tmp_path: Path) -> None:
    bench = Workbench(tmp_path, tmp_path / "campaign.toml", tmp_path / "results")
    screen = FilesScreen(SimpleNamespace(bench=bench, scheme="light"))
    mapping = opened(scope_file(tmp_path, "fill_1.CSV"))
    mapping.alike = tuple(scope_file(tmp_path, f"fill_{i}.CSV").name for i in (2, 3, 4))
    (text,) = re.findall(r'data-do="add"[^>]*>([^<]*)<', screen._adding(mapping))
    assert text == "Convert and add to the campaign"


def test_a_motor_that_is_off_is_said_on_the_page(tmp_path: Path) -> None:
    mapping = opened(scope_file(tmp_path, "swing.CSV"))
    mapping.chosen(0, "unit", "ms")
    mapping.chosen(1, "target", "theta_rad")
    found = plausibility(mapping, None)
    assert "--set" not in found.text and found.asks
    assert "<code>motor_torque_nm=0</code>" in found.text and "What no column holds" in found.text


@pytest.mark.parametrize(
    ("text", "unit", "value"),
    [
        ("0.12", "m", 0.12), ("4,607 cm2", "m2", 4.607e-4), ("72.72mm", "m", 0.07272),
        ("30 °C", "K", 303.15), ("2.1 bar(g)", "Pa", 309e3), ("3.09 bar", "Pa", 309e3),
        ("1.5e-3", "s", 1.5e-3), ("287.0", "J/(kg K)", 287.0),
    ],
)  # fmt: skip
def test_a_constant_may_have_its_own_unit(text: str, unit: str, value: float) -> None:
    assert edits.in_si(text, unit, "[x] y", 99e3) == value


@pytest.mark.parametrize(
    ("text", "said"),
    [("abc", "not a number"), ("4 kg", "a mass"), ("2 bar(g)", "a gauge pressure")],
)
def test_a_constant_that_is_none_is_refused(text: str, said: str) -> None:
    with pytest.raises(InputError, match=rf"\[x\] y: .*{said}"):
        edits.in_si(text, "Pa", "[x] y", None)


def test_a_run_that_ended_leads_to_its_report(tmp_path: Path) -> None:
    (tmp_path / "results").mkdir()
    (tmp_path / "results/report.html").touch()
    bench = Workbench(tmp_path, tmp_path / "campaign.toml", tmp_path / "results")
    job = Job("running", ("run", "campaign.toml", "-o", "results"), tmp_path, {})
    assert list(written_by(job)) == []
    job.code = 0
    said = ["a.csv: odd", "b.csv: odd", "1 of 2 samples lack", "2 of 9 samples lack"]
    said += ["third", "fourth", "fifth: -v shows them"]
    job.lines = [f"sysid: notice: {one}" for one in said]
    bench.job = job
    page = SimpleNamespace(bench=bench, screens=dict.fromkeys(("fit", "export")), current="fit")
    page.message, page._made = "", lambda job: PageWindow._made(page, job)
    text = PageWindow._strip(page)
    assert 'href="files/results/report.html"' in text and 'data-value="2"' in text
    assert "a.csv, b.csv: odd" in text and "1 of 2 samples lack (likewise 2, of 9)" in text
    # What is not shown at once is folded whole, as it was printed.
    folded = text.partition("2 more notices")[2]
    assert "fourth" in folded and "fifth: -v shows them" in folded


def test_a_campaign_is_checked_log_by_log(tmp_path: Path) -> None:
    path = write_small(tmp_path)
    bench = Workbench(tmp_path, path, tmp_path / "results")
    files = [entry.file for entry in bench.campaign().logs]
    screen = IdentifyScreen(SimpleNamespace(bench=bench, scheme="light"))

    def shown(pieces: int) -> str:
        for _ in range(pieces):
            waiting = screen.later.pop(0)()
            assert waiting is not None
            with ThreadPoolExecutor(1) as other:  # this thread may have a loop of playwright's
                drawn: Any = other.submit(asyncio.run, waiting).result()
            drawn()
        return str(screen.answer.object)

    screen.draw(screen.read())
    text = shown(0)  # before any log is read
    assert all(file in text for file in files) and f"0 of {len(files)} logs" in text
    assert text.count("is being checked") == len(files)
    text = shown(1)
    assert text.count("is being checked") == len(files) - 1 and "static friction" in text
    text = shown(len(screen.later))
    assert "Which log identifies which parameter" in text
    cards = text.partition("<table")[0]
    assert "Needs valve-pwm tests of valve A" in cards and "0 duties" not in cards
    # A second visit knows the answer; of a file that has changed it asks anew, of that one alone.
    screen.draw(screen.read())
    assert screen.later == [] and str(screen.answer.object) == text
    os.utime(tmp_path / files[1], ns=(0, 0))
    screen.draw(screen.read())
    assert shown(0).count("is being checked") == 1 and len(screen.later) == 2


# What `sysid advise -o --json` prints, in short.
ADVICE = {
    "parameters": [{"name": "friction.coulomb_nm", "value": 0.17, "unit": "Nm", "std_now": 0.002,
                    "best_test": None}],
    "tests": [{"kind": "motion-motor", "test": "motion-motor: sine, 10 s", "duration_s": 10.0,
               "gain": 0.5, "motion_gain": 0.7, "std_after": {"friction.coulomb_nm": 0.001}}],
    "ties": [{"pair": ["friction.coulomb_nm", "friction.viscous_nm_s_per_rad"],
              "correlation_now": -0.99, "test": None, "correlation_after": -0.99}],
    "smallest_sizes": [{"effect": "backlash", "strength": "gap_rad", "unit": "rad", "usual": 0.004,
                        "now": None, "after": {"motion-motor: sine, 10 s": 1e-4}}],
    "skipped_effects": {}, "threshold_std": 4.1, "notices": [],
    "test": {"kind": "motion-motor", "tests": 2, "duration_s": 10.0, "expected": [
        {"parameter": "valves.a.c_fill", "value": 1e-6, "std_now": None, "std_after": 1e-9,
         "unit": "kg/(s Pa^0.5)"}]},
}  # fmt: skip


def test_advice_is_said_as_the_report_says_it(tmp_path: Path) -> None:
    path = write_small(tmp_path)
    (tmp_path / "results").mkdir()
    bundle = Path(shutil.copy(golden_bundle("diagnosed"), tmp_path / "results/bundle.json"))
    bench = Workbench(tmp_path, path, tmp_path / "results")
    asked: list[list[str]] = []
    screen = IdentifyScreen(
        SimpleNamespace(bench=bench, scheme="light", start=lambda what, words: asked.append(words))
    )
    screen.draw(screen.read())
    for name in ("friction.coulomb_nm", "backlash", "valves.a.c_fill"):
        in_a_loop(partial(screen.do, "identify-for", name))
    in_a_loop(partial(screen.do, "identify-not:backlash", None))
    menu = str(screen.advice.object)
    assert "Coulomb friction ×" in menu and ">Backlash in the motor" in menu
    assert not [
        word for word in re.findall(r">([^<]*)<", menu) if "_" in word or "friction." in word
    ]
    in_a_loop(partial(screen.do, "identify-play", None))
    (words,) = asked
    assert words[-5:] == ["--for", "friction.coulomb_nm", "--for", "valves.a.c_fill", "--json"]
    job = Job("advising", tuple(words), tmp_path, {})
    job.code, job.output = 0, json.dumps(ADVICE)
    in_a_loop(lambda: screen.finished(job))
    panes = screen.draw(screen.read())
    said = "".join(str(pane.object) for pane in panes[2:])
    assert bundle.exists() and "Record motion-motor: sine, 10 s." in said
    titles = ("Coulomb friction, by 50 %", "Valve A, unchoked filling coefficient", "Backlash")
    assert all(title in said for title in titles) and "<pre" not in said


def test_a_comparison_without_errors_draws_no_empty_figure(tmp_path: Path) -> None:
    bench = Workbench(tmp_path, tmp_path / "campaign.toml", tmp_path / "results")
    screen = CompareScreen(SimpleNamespace(bench=bench, scheme="light"))
    fitted = read_bundle(golden_bundle("diagnosed"))
    thesis = read_bundle(REPOSITORY / "datasets/thesis/reference_bundle.json")
    for other, count in ((thesis, 2), (fitted, 3)):  # the responses; and each number
        found = compare(fitted, other)
        panes = screen.draw(CompareContent((), (), found, (), ""))
        assert len(panes[3].objects) == count


def test_a_written_file_is_explained_beneath_its_name(tmp_path: Path) -> None:
    bench = Workbench(tmp_path, tmp_path / "campaign.toml", tmp_path / "results")
    screen = ExportScreen(SimpleNamespace(bench=bench, scheme="light"))
    (tmp_path / "results").mkdir()
    path = Path(shutil.copy(golden_bundle("diagnosed"), tmp_path / "results/bundle.json"))
    for other in ("advice.json", "report.html", "export/model.h"):
        (tmp_path / "results" / other).parent.mkdir(exist_ok=True)
        (tmp_path / "results" / other).touch()
    first = [one.name for one in screen._files()]
    assert first == ["report.html", "model.h", "bundle.json", "advice.json"]
    name, size, get = screen._line(path)
    assert name.startswith("<b>results/bundle.json</b><br><small>the model")
    assert (
        re.fullmatch(r"\d+\N{NO-BREAK SPACE}kB", size) and 'href="files/results/bundle.json"' in get
    )


# What a user would type for each button of the screen, the output's name last.
TYPED = {
    "out:c": "export results/bundle.json --format c -o typed/bundle.h",
    "out:mat": "export results/bundle.json --format mat -o typed/bundle.mat",
    "out:json": "export results/bundle.json --format json -o typed/bundle.json",
    "out:fmu": "export results/bundle.json --format fmu -o typed/bundle.fmu",
    "out:mjcf": "export results/bundle.json --format mjcf -o typed/bundle.xml",
    "out-report": "validate campaign.toml --bundle results/bundle.json --report typed/bundle.html",
}


@dataclass
class Pressed:
    """A window that runs the command of a button as the workbench does, to its end."""

    bench: Workbench
    scheme: str = "light"
    job: Any = None

    def start(self, what: str, words: Sequence[str], expected: Any = None) -> None:
        self.job = Job(what, tuple(words), self.bench.folder, {})
        self.job.start()
        wait_until(lambda: self.job.is_done)
        assert self.job.code == 0, (self.job.lines, self.job.notices, self.job.output)


def in_a_loop(act: Callable[[], Any]) -> None:
    """Await something in a thread of its own: this one may have a loop of playwright's."""
    with ThreadPoolExecutor(1) as other:
        other.submit(lambda: asyncio.run(act())).result()


def written_in(folder: Path) -> dict[str, bytes]:
    """The files below a folder; the minute in which a page was written is none of its content."""
    minute = re.compile(rb"\d{4}-\d\d-\d\d \d\d:\d\d UTC")
    found = {p.relative_to(folder).as_posix(): p.read_bytes() for p in folder.rglob("*")
             if p.is_file()}  # fmt: skip
    return {n: minute.sub(b"", c) if n.endswith(".html") else c for n, c in found.items()}


@pytest.mark.parametrize("button", TYPED)
def test_a_button_writes_what_its_command_writes(button: str, tmp_path: Path) -> None:
    path = write_small(tmp_path)
    (tmp_path / "results").mkdir()
    # That of the thesis was fitted to no log: the report's campaign may be any.
    given = REPOSITORY / "datasets/thesis/reference_bundle.json"
    given = given if button == "out-report" else golden_bundle("diagnosed")
    shutil.copy(given, tmp_path / "results/bundle.json")
    (tmp_path / "typed").mkdir()
    window = Pressed(Workbench(tmp_path, path, tmp_path / "results"))
    screen = ExportScreen(window)
    screen.draw(screen.read())
    before = written_in(tmp_path / "results")
    in_a_loop(lambda: screen.do(button, None))
    # In a process of its own, as in a terminal: Bokeh numbers its models from the process's first.
    words = [sys.executable, "-m", "sysid", *TYPED[button].split()]
    subprocess.run(words, cwd=tmp_path, check=True, capture_output=True)
    pressed = written_in(tmp_path / "results")
    made = {name.removeprefix("export/"): pressed[name] for name in pressed.keys() - before.keys()}
    assert made.keys() == written_in(tmp_path / "typed").keys()
    assert made == written_in(tmp_path / "typed")


def test_a_report_has_the_diagnosis_of_its_bundle(tmp_path: Path) -> None:
    bench = Workbench(tmp_path, write_small(tmp_path), tmp_path / "results")
    (tmp_path / "results").mkdir()
    shutil.copy(golden_bundle("diagnosed"), tmp_path / "results/bundle.json")
    shutil.copy(golden_bundle("validated"), tmp_path / "results/fitted.json")
    read = read_diagnosis(tmp_path / "results/bundle.json")
    content = {**json.loads(json.dumps(read.content).replace("NaN", "0.0")), "figures": {}}
    asked: list[list[str]] = []
    window = SimpleNamespace(
        bench=bench, scheme="light", start=lambda what, words: asked.append(words)
    )
    screen = ExportScreen(window)
    for holds in (False, True):
        if holds:
            (tmp_path / "results/diagnosis.json").write_text(json.dumps(content))
        for name in ("bundle", "fitted"):
            screen.chosen = tmp_path / f"results/{name}.json"
            screen.read()
            in_a_loop(lambda: screen.do("out-report", None))
            given = asked.pop()[-2:] == ["--diagnosis", "results/diagnosis.json"]
            assert given == (holds and name == "bundle")


def test_a_unit_stands_clear_of_its_colours() -> None:
    from bokeh.models import ColorBar

    cells = ColourMap(np.arange(3.0), np.arange(2.0), np.zeros((2, 3)), (0.0, 1.0), "g/s")
    figure = Figure("f", "Flow", "", (Panel(Scale("x"), Scale("y"), (cells,)),))
    (bar,) = draw(figure, "light").layout.select({"type": ColorBar})
    assert bar.title == "g/s" and bar.title_standoff > 2 * ColorBar().title_standoff


def test_panels_of_the_same_curves_have_one_legend() -> None:
    time_s = np.arange(5.0)
    two = tuple(Curve(time_s, time_s, name) for name in ("one", "other"))
    off = (Curve(time_s, time_s, ""),)
    panels = [TracePanel(Scale("x"), curves) for curves in (two, off, two, two[:1])]
    traces = TraceView(panels, "light")
    labels = [[i.label["value"] for p in one.legend for i in p.items] for one in traces.plots]
    assert labels == [["one", "other"], [], [], ["one"]]
    # A line that is hidden by the legend is hidden below it too.
    (linked,) = traces.plots[0].renderers[0].js_property_callbacks["change:visible"]
    assert linked.args["other"] is traces.plots[2].renderers[0]


def test_a_million_samples_are_thinned_to_the_window() -> None:
    time_s = np.arange(1_000_000) * 1e-3
    values = np.sin(time_s)
    values[654_321] = 9.0
    traces = TraceView([TracePanel(Scale("x"), (Curve(time_s, values, "x"),))], "light")
    (_, source) = traces.sources[0]
    assert len(source.data["x"]) <= 2 * BUCKETS + 2 and source.data["y"].max() == 9.0
    traces.range.start, traces.range.end = 654.0, 655.0
    shown = source.data["x"]
    assert 1000 <= len(shown) <= 1004 and shown[0] >= 653.9 and shown[-1] <= 655.1


def test_a_window_asks_no_other_host_for_its_styles(tmp_path: Path) -> None:
    from bokeh.document import Document
    from bokeh.models import ImportedStyleSheet
    from panel.io.state import set_curdoc

    from sysid.app.page import window

    bench = Workbench(tmp_path, tmp_path / "campaign.toml", tmp_path / "results")
    document = Document()
    with set_curdoc(document):  # no page was written for it
        window(bench).server_doc(document)
    sheets = [
        sheet.url for root in document.roots for sheet in root.select({"type": ImportedStyleSheet})
    ]
    assert sheets and not [url for url in sheets if "//" in url]


def test_a_gate_is_as_strict_for_its_own_page() -> None:
    assert len(Gate(1).token) >= 32 and Gate(1).token != Gate(1).token


# --- jobs -----------------------------------------------------------------------------------


def processes_of(group: int) -> list[int]:
    """The processes of a group that have not ended."""
    found = []
    for stat in Path("/proc").glob("[0-9]*/stat"):
        try:
            fields = stat.read_text().rpartition(")")[2].split()
        except OSError:
            continue
        if int(fields[2]) == group and fields[0] != "Z":
            found.append(int(stat.parent.name))
    return found


def test_a_cancelled_job_leaves_nothing(tmp_path: Path) -> None:
    write_small(tmp_path)
    job = Job("running", ("run", "campaign.toml", "-o", "results"), tmp_path, {"check": 4.0})
    job.start()
    until = time.monotonic() + 30.0
    while not job.lines and time.monotonic() < until:
        time.sleep(0.02)
    assert job.share is not None and "left" in job.state
    group = job._process.pid
    job.cancel()
    assert job.cancelled and "cancelled" in job.state
    if Path("/proc").is_dir():
        assert processes_of(group) == []
    left = [p for p in (tmp_path / "results").glob("**/*") if p.suffix == ".tmp"]
    assert left == []


def test_a_killed_server_loses_nothing_and_leaves_nothing(
    tmp_path: Path, browser: Any, request: pytest.FixtureRequest
) -> None:
    """One of its own: others may still be asked of the module's."""
    from sysid.app.journal import JOURNAL_FILE

    server, folder = started(tmp_path), tmp_path
    # Left running by a test that fails, it would make the next one fail, too.
    request.addfinalizer(server.kill)
    page = Page(server, browser.new_page()).open()
    page.show("1")
    field = page.page.locator("input[data-do='rig:cylinder:pitch_radius_m']")
    field.fill("0.025123456")
    field.press("Enter")
    wait_until(lambda: (folder / JOURNAL_FILE).exists())
    page.page.close()
    kept = (folder / "campaign.toml").read_bytes()
    journal = Journal.read(folder)
    assert server.kill() == -signal.SIGKILL
    again = Server(folder).start()
    request.addfinalizer(again.kill)
    assert again.ask(f"/?token={again.token}").status == 200
    assert again.ask(f"/?token={server.token}").status == 403
    assert (folder / "campaign.toml").read_bytes() == kept
    assert Journal.read(folder) == journal
    assert again.kill(signal.SIGINT) == 0
