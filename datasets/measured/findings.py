"""The combined results of the measured sets: one line per campaign, and whether it repeats.

Everything is computed from the result of `datasets.measured.run.run_sets`.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from sysid.blocks.numbers import MISSING, number, percent
from sysid.diagnosis.wording import LEAST_SHOWN, joined, regressor_name
from sysid.errors import input_error
from sysid.io.channels import channel_of
from sysid.io.files import write_atomic

Content = Mapping[str, Any]

BEGIN, END = "<!-- measured -->", "<!-- /measured -->"
COLUMNS = (
    "Set",
    "Found",
    "Held-out RMSE of",
    "Before",
    "After",
    "Correct model",
    "After / correct",
    "Down by",
    "Remains",
    "Base model",
)
# Number of parameters that a line names before it counts the others.
_MOST_NAMES = 4


@dataclass(frozen=True)
class Errors:
    """RMSE of one channel on the held-out recordings, in the channel's SI unit.

    None where the diagnosis gives none.
    """

    channel: str
    before: float | None
    after: float | None
    noise_floor: float | None

    @property
    def percent_down(self) -> float | None:
        """Reduction relative to `before`, %; negative where the error grew."""
        if not self.before or self.after is None:
            return None
        return 100.0 * (1.0 - self.after / self.before)


@dataclass(frozen=True)
class Naming:
    """How many of `repeats` name an effect: `same` by its id, `ambiguous` by an equivalent one.

    `id` None: repeats that name no effect at all. `undecided`: repeats that do not name it,
    but say that it is ambiguous. `unsteady`: the campaign's own verdict says `ambiguous`,
    because parts of its training tests do not name the effect.
    """

    id: str | None
    repeats: int
    same: int
    ambiguous: int
    undecided: int = 0
    unsteady: bool = False

    @property
    def agree(self) -> int:
        """Repeats that name it, or an effect indistinguishable from it."""
        return self.same + self.ambiguous

    @property
    def status(self) -> str:
        """`repeated` by all repeats; `ambiguous` where its own verdict or all others say so."""
        if self.agree == self.repeats:
            return "repeated"
        return "ambiguous" if self.unsteady or self.is_left_open else "neither"

    @property
    def is_left_open(self) -> bool:
        """Whether every repeat that does not name it says that it is ambiguous."""
        return self.agree + self.undecided == self.repeats


@dataclass(frozen=True)
class Agreement:
    """Of one campaign: `agree` of `repeats` name all its effects; `namings` per effect.

    `others` counts the repeats that name an effect besides, by its id; `failed` those that
    gave no verdict (they are among `repeats`, and agree with nothing).
    """

    of: str
    repeats: int
    agree: int
    namings: tuple[Naming, ...]
    others: Mapping[str, int]
    failed: int

    @property
    def sentence(self) -> str:
        """The answer to whether the verdict repeats."""
        of = f"{self.agree} of {self.repeats} repeats"
        first = self.namings[0]
        if first.id is None:
            text = f"No effect is named either by {of}"
        elif len(self.namings) == 1:
            text = f"The same effect, {first.id}, is named by {of}{_by_likes(first)}"
        else:
            each = joined([f"{n.id} by {n.agree}{_by_likes(n)}" for n in self.namings])
            text = f"The same effects are all named by {of}: {each}"
        if self.others:
            named = joined([f"{id} ({count})" for id, count in self.others.items()])
            text += f"; besides, repeats name {named}"
        if self.failed:
            text += f"; {self.failed} gave no verdict"
        missed = [n for n in self.namings if n.id is not None and n.agree < n.repeats]
        said = {
            "The verdict itself says ambiguous of": [n for n in missed if n.unsteady],
            "The repeats that do not name it say ambiguous of": [
                n for n in missed if n.is_left_open and not n.unsteady
            ],
            "The verdict neither repeats nor says ambiguous of": [
                n for n in missed if n.status == "neither"
            ],
        }
        sentences = [f" {w} {joined([str(n.id) for n in m])}." for w, m in said.items() if m]
        return f"{text}.{''.join(sentences)}"

    def to_json(self) -> dict[str, Any]:
        """As JSON types."""
        namings = [{**vars(n), "agree": n.agree, "status": n.status} for n in self.namings]
        return {**vars(self), "namings": namings, "sentence": self.sentence}


def _by_likes(naming: Naming) -> str:
    """How many of those that agree name an equivalent effect."""
    if not naming.ambiguous:
        return ""
    return f" ({naming.ambiguous} by one indistinguishable from it in the recordings)"


def errors_of(campaign: Content) -> list[Errors]:
    """The held-out errors of a campaign, the channel of the part itself first."""
    residual = (campaign["diagnosis"] or {}).get("residual", {})
    return [
        Errors(name, e.get("before"), e.get("after"), e.get("noise_floor"))
        for name, e in residual.items()
    ]


def mains(measured: Content) -> list[Content]:
    """The campaigns of a set that are not repeats."""
    return [campaign for campaign in measured["campaigns"] if not campaign["repeat"]]


def repeats_of(measured: Content, main: Content) -> list[Content]:
    """The repeats of `main`."""
    return [c for c in measured["campaigns"] if c["repeat"] and c["of"] == main["file"]]


def agreement(measured: Content, main: Content) -> Agreement | None:
    """Whether the verdict of `main` repeats; None without repeats, or without a verdict."""
    repeats = repeats_of(measured, main)
    if not repeats or main["diagnosis"] is None:
        return None
    effects = main["diagnosis"]["effects"]
    diagnoses = [r["diagnosis"] for r in repeats if r["diagnosis"] is not None]
    found = [diagnosis["effects"] for diagnosis in diagnoses]
    failed = len(repeats) - len(found)
    if not effects:
        none = sum(not named for named in found)
        naming = Naming(None, len(repeats), none, 0)
        others = _others((), found)
        return Agreement(main["file"], len(repeats), none, (naming,), others, failed)
    namings = []
    for effect in effects:
        same = sum(_names(named, effect) == "same" for named in found)
        like = sum(_names(named, effect) == "ambiguous" for named in found)
        undecided = sum(_leaves_open(diagnosis, effect) for diagnosis in diagnoses)
        unsteady = _is_unsteady(effect)
        namings.append(Naming(effect["id"], len(repeats), same, like, undecided, unsteady))
    agree = sum(all(_names(named, effect) for effect in effects) for named in found)
    others = _others(effects, found)
    return Agreement(main["file"], len(repeats), agree, tuple(namings), others, failed)


def _is_unsteady(effect: Content) -> bool:
    """Whether parts of the training tests do not name an effect that all of them together name."""
    parts = effect.get("repeats", {})
    return bool(parts) and parts["agree"] < parts["parts"]


def _leaves_open(diagnosis: Content, effect: Content) -> bool:
    """Whether a diagnosis does not name an effect, but says that it is ambiguous."""
    open_ones = {other["id"] for other in diagnosis.get("undecided", ())}
    return effect["id"] in open_ones and not _names(diagnosis["effects"], effect)


def _names(named: Sequence[Content], effect: Content) -> str:
    """`same` if an effect is among those named, `ambiguous` if an equivalent one is, else ''."""
    if any(other["id"] == effect["id"] for other in named):
        return "same"
    return "ambiguous" if any(_alike(other, effect) for other in named) else ""


def _alike(one: Content, other: Content) -> bool:
    """Whether the recordings of either cannot distinguish the two effects."""
    return (
        one["id"] == other["id"]
        or one["id"] in other["ambiguous_with"]
        or other["id"] in one["ambiguous_with"]
    )


def _others(effects: Sequence[Content], found: Sequence[Sequence[Content]]) -> dict[str, int]:
    counts: dict[str, int] = {}
    for named in found:
        for other in named:
            if not any(_alike(other, effect) for effect in effects):
                counts[other["id"]] = counts.get(other["id"], 0) + 1
    return counts


def with_agreement(results: Content) -> dict[str, Any]:
    """The results with each set's answers under `agreement`, and the errors' percentages."""
    found = []
    for measured in results["sets"]:
        campaigns = [
            {**c, "percent_down": {e.channel: e.percent_down for e in errors_of(c)}}
            for c in measured["campaigns"]
        ]
        answers = [agreement(measured, main) for main in mains(measured)]
        said = [answer.to_json() for answer in answers if answer is not None]
        found.append({**measured, "campaigns": campaigns, "agreement": said})
    return {**results, "sets": found}


# --- in words ---------------------------------------------------------------------------


def base_text(law: Mapping[str, Content], most: int | None = None) -> str:
    """The base law by the names of its parameters, part by part."""
    parts: dict[str, list[str]] = {}
    for name, estimate in law.items():
        if estimate.get("value") is not None:
            part, _, parameter = name.rpartition(".")
            parts.setdefault(part, []).append(parameter)
    said = []
    for part, names in parts.items():
        shown = names if most is None or len(names) <= most else [*names[:most], "..."]
        said.append(f"{part}: {', '.join(shown)}" if part else ", ".join(shown))
    return "; ".join(said) or MISSING


def found_text(diagnosis: Content) -> str:
    """The effects that were added, each with those indistinguishable from it."""
    said = []
    for effect in diagnosis["effects"]:
        rivals = effect["ambiguous_with"]
        said.append(effect["id"] + (f" (or {joined(rivals, 'or')})" if rivals else ""))
    return "; ".join(said) or "no effect"


def remains_text(diagnosis: Content) -> str:
    """The unexplained structure, with its share of the residual's variance where there is any."""
    said = [
        f"{channel_of(e['channel']).name} over {regressor_name(e['regressor'])} "
        f"({number(100.0 * e['share'], 2)} %)"
        for e in diagnosis["unexplained"]
        if (e["share"] or 0.0) >= LEAST_SHOWN
    ]
    if not said and diagnosis["unexplained"]:
        return "held-out errors above those of a correct model, over no regressor"
    return "; ".join(said) or "no structure found"


def overview(results: Content) -> list[tuple[str, ...]]:
    """A row of `COLUMNS` for each campaign that is not a repeat; failures say why."""
    return [row for measured in results["sets"] for row in _rows(measured)]


def _rows(measured: Content) -> Iterator[tuple[str, ...]]:
    blank = (MISSING,) * (len(COLUMNS) - 3)
    if measured["problem"] is not None:
        yield (measured["name"], f"failed: {measured['problem']}", *blank, MISSING)
        return
    several = len(mains(measured)) > 1
    for main in mains(measured):
        title = f"{measured['name']}, {main['name']}" if several else str(measured["name"])
        law = base_text(main["law"], _MOST_NAMES)
        if main["diagnosis"] is None:
            yield (title, f"failed: {main['problem']}", *blank, law)
            continue
        errors = errors_of(main)
        cells = error_cells(errors[0]) if errors else ("nothing held out", *(MISSING,) * 5)
        found, remains = found_text(main["diagnosis"]), remains_text(main["diagnosis"])
        known = f"; known: {main['known']}" if main.get("known") else ""
        yield (title, found, *cells, f"{remains}{known}", law)


def error_cells(errors: Errors) -> tuple[str, str, str, str, str, str]:
    """Channel, before, after, of a correct model, after over that, and the percentage down."""
    before, after, floor = errors.before, errors.after, errors.noise_floor
    times = None if after is None or not floor else after / floor
    down = percent(errors.percent_down, 2)
    return errors.channel, number(before), number(after), number(floor), number(times, 2), down


# --- the README's table -----------------------------------------------------------------


def markdown_table(results: Content) -> str:
    """The overview as a table in Markdown."""
    rows = [COLUMNS, ("---",) * len(COLUMNS), *overview(results)]
    return "\n".join("| " + " | ".join(_markdown_cell(c) for c in row) + " |" for row in rows)


def _markdown_cell(text: str) -> str:
    """A safe table cell: no line ends, no bars, no markup."""
    line = " ".join(text.split())
    for sign in "\\|<>*`":
        line = line.replace(sign, f"\\{sign}")
    return line


def write_readme_table(path: Path, table: str) -> None:
    """Put `table` between the two markers of a Markdown file, whole or not at all.

    Raises InputError unless each marker occurs exactly once, in order.
    """
    try:
        text = path.read_text("utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise input_error(path, f"cannot be read: {error}", "name a Markdown file") from None
    head, begin, rest = text.partition(BEGIN)
    _, end, tail = rest.partition(END)
    if not begin or not end or BEGIN in rest or END in tail or END in head:
        raise input_error(
            path, f"{BEGIN} and {END} do not occur once each", "write both, each on its own line"
        )
    write_atomic(path, f"{head}{BEGIN}\n\n{table}\n\n{END}{tail}")


__all__ = [
    "BEGIN",
    "COLUMNS",
    "END",
    "Agreement",
    "Errors",
    "Naming",
    "agreement",
    "base_text",
    "error_cells",
    "errors_of",
    "found_text",
    "mains",
    "markdown_table",
    "overview",
    "remains_text",
    "repeats_of",
    "with_agreement",
    "write_readme_table",
]
