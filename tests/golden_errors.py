"""Spoilt rig files, campaigns, logs and arguments: name -> what spoils a folder and the words.

Rig files are spoilt key by key, so that every one is missed, misspelt, mistyped and mistaken
in its unit once. Spoilt logs are those of `test_bad_input.py`.
"""

from __future__ import annotations

import copy
import json
import tomllib
from collections.abc import Callable
from typing import Any

from golden_folder import GOLDEN, Folder

Spoil = Callable[[Folder], list[str]]
CHECK = ["check", "motion.csv"]
_RIGS = {
    name: tomllib.loads((GOLDEN / "inputs" / f"{name}.toml").read_text("utf-8"))
    for name in ("rig", "rig_linear")
}
_EXTRA = {
    "valves": {"on_delay_s": 0.00151, "off_delay_s": 0.00195},
    "tank": {"volume_m3": 0.001},
    "sampling": {"period_s": 0.001},
    "sensors": {"encoder_zero_counts": 0, "pressure_noise_pa": 157.0},
}


def _toml(content: dict[str, Any]) -> str:
    """Tables of numbers, text and booleans; what is no table goes on top."""
    top = [f"{k} = {json.dumps(v)}\n" for k, v in content.items() if not isinstance(v, dict)]
    rest = [
        f"[{name}]\n" + "".join(f"{k} = {json.dumps(v)}\n" for k, v in table.items())
        for name, table in content.items()
        if isinstance(table, dict)
    ]
    return "".join([*top, *rest])


def _rig_file(content: dict[str, Any], words: list[str]) -> Spoil:
    def spoil(folder: Folder) -> list[str]:
        folder.write("rig.toml", _toml(content))
        return words

    return spoil


def _changed(rig: dict[str, Any], section: str, key: str, kind: str) -> dict[str, Any]:
    content = copy.deepcopy(rig)
    table = content[section]
    value = table.pop(key)
    number = isinstance(value, int | float)
    if kind == "misspelt":
        table[key.replace("_", "", 1) if "_" in key else key[:-1] + "x"] = value
    elif kind == "mistyped":
        table[key] = str(value) if number else 7
    elif kind == "too large":
        table[key] = 1e15 if number else "no such word"
    elif kind == "negative":
        table[key] = -abs(value) - 1.0 if number else ""
    elif kind == "truth":
        table[key] = True
    return content


def _rig_keys() -> dict[str, Spoil]:
    kinds = ("missing", "misspelt", "mistyped", "too large", "negative")
    cases: dict[str, Spoil] = {}
    for name, words in (("rig", CHECK), ("rig_linear", CHECK)):
        rig = copy.deepcopy(_RIGS[name]) | (_EXTRA if name == "rig" else {})
        for section, table in rig.items():
            for key in table:
                for kind in kinds if name == "rig" else kinds[:3]:
                    changed = _changed(rig, section, key, kind)
                    cases[f"{name}: {section}.{key} {kind}"] = _rig_file(changed, words)
        for section in rig:
            without = {k: v for k, v in rig.items() if k != section}
            cases[f"{name}: no [{section}]"] = _rig_file(without, words)
            misspelt = {(k + "s" if k == section else k): v for k, v in rig.items()}
            cases[f"{name}: [{section}s]"] = _rig_file(misspelt, words)
            flat = {**without, section: 3}
            cases[f"{name}: {section} = 3"] = _rig_file(flat, words)
    cases["rig: air.temperature_k true"] = _rig_file(
        _changed(_RIGS["rig"], "air", "temperature_k", "truth"), CHECK
    )
    return cases


def _replaced(file: str, old: str, new: str, words: list[str]) -> Spoil:
    def spoil(folder: Folder) -> list[str]:
        text = folder.text(file)
        assert old in text
        folder.write(file, text.replace(old, new, 1))
        return words

    return spoil


def _rig_slips() -> dict[str, Spoil]:
    """Slips of unit, keys that contradict each other, and what is no TOML."""
    slips = {
        "degrees Celsius": ("temperature_k = 298.4", "temperature_k = 25.25"),
        "kPa": ("supply_pressure_pa = 312000.0", "supply_pressure_pa = 312.0"),
        "gauge": ("supply_pressure_pa = 312000.0", "supply_pressure_pa = 100000.0"),
        "supply below the atmosphere": ("atmospheric_pressure_pa = 100200.0", "x = 1"),
        "mm2": ("area_a_m2 = 0.0004325", "area_a_m2 = 432.5"),
        "mm": ("stroke_m = 0.11739", "stroke_m = 117.39"),
        "ms": ("period_s = 0.005", "period_s = 5000"),
        "a period of zero": ("period_s = 0.005", "period_s = 0"),
        "infinite": ("period_s = 0.005", "period_s = inf"),
        "not a number": ("period_s = 0.005", "period_s = nan"),
        "offset within the stroke": ("offset_b_m = 0.072626", "offset_b_m = 0.05"),
        "payload without length": (
            "payload_mass_kg = 0.0\npayload_length_m = 0.37",
            "payload_mass_kg = 1",
        ),
        "two faults": ("[air]\n", "[air]\nfoo = 1\n[aero]\n"),
        "bracket": ("[air]", "[air"),
        "doubled key": ("stroke_m = 0.11739", "stroke_m = 0.11739\nstroke_m = 0.2"),
        "doubled section": ("[pwm]", "[air]"),
        "decimal comma": ("stroke_m = 0.11739", "stroke_m = 0,11739"),
        "open quote": ('"horizontal"', '"horizontal'),
        "upper case": ('"horizontal"', '"Horizontal"'),
        "array": ("stroke_m = 0.11739", "stroke_m = [0.1, 0.2]"),
        "unknown key": ("[pwm]", "[pwm]\nflavour = 3"),
        "unknown section": ("[pwm]", "[garden]\na = 1\n[pwm]"),
    }
    return {f"rig: {k}": _replaced("rig.toml", *v, CHECK) for k, v in slips.items()}


_HEAD = 'rig = "rig.toml"\n'
_LOG = '[[log]]\nkind = "motion-motor"\nfile = "motion.csv"\n'
_FIT = ["fit", "campaign.toml", "-o", "out.json"]
_WORDS = {
    "validate": ["validate", "campaign.toml", "--bundle", "bundle.json"],
    "diagnose": ["diagnose", "campaign.toml", "--bundle", "bundle.json"],
    "run": ["run", "campaign.toml", "-o", "results"],
}

_CAMPAIGNS = {
    "empty": "",
    "no rig": _LOG,
    "rig of another type": "rig = 3\n" + _LOG,
    "rig absent": 'rig = "other.toml"\n' + _LOG,
    "rig misspelt": 'rigg = "rig.toml"\n' + _LOG,
    "no log": _HEAD,
    "logs empty": _HEAD + "log = []\n",
    "log a table": _HEAD + _LOG.replace("[[log]]", "[log]"),
    "log a number": _HEAD + "log = [3]\n",
    "logs misspelt": _HEAD + _LOG.replace("[[log]]", "[[logs]]"),
    "no kind": _HEAD + _LOG.replace('kind = "motion-motor"\n', ""),
    "no file": _HEAD + _LOG.replace('file = "motion.csv"\n', ""),
    "file a number": _HEAD + _LOG.replace('"motion.csv"', "3"),
    "file absent": _HEAD + _LOG.replace("motion.csv", "gone.csv"),
    "file a folder": _HEAD + _LOG.replace("motion.csv", "."),
    "kind unknown": _HEAD + _LOG.replace("motion-motor", "motion"),
    "kind a number": _HEAD + _LOG.replace('"motion-motor"', "3"),
    "kind misspelt": _HEAD + _LOG.replace("kind =", "kinds ="),
    "use unknown": _HEAD + _LOG + 'use = "train"\n',
    "use misspelt": _HEAD + _LOG + 'usee = "fit"\n',
    "use a truth": _HEAD + _LOG + "use = true\n",
    "valve unknown": _HEAD + _LOG + 'valve = "c"\n',
    "valve upper case": _HEAD + _LOG + 'valve = "A"\n',
    "valve misspelt": _HEAD + _LOG + 'valv = "a"\n',
    "used twice": _HEAD + _LOG + _LOG + 'use = "holdout"\n',
    "the same log twice": _HEAD + _LOG + _LOG,
    "second entry spoilt": _HEAD + _LOG + _LOG.replace("motion-motor", "x"),
    "map no table": _HEAD + _LOG + "map = 3\n",
    "map shared no table": _HEAD + "map = 3\n" + _LOG,
    "map of an absent column": _HEAD + _LOG + 'map = { time_s = "t:s" }\n',
    "map of an unknown unit": _HEAD + _LOG + 'map = { theta_rad = "theta_rad:foo" }\n',
    "map to an unknown target": _HEAD + _LOG + 'map = { tetha_rad = "theta_rad" }\n',
    "key unknown": _HEAD + "colour = 3\n" + _LOG,
    "only held out": _HEAD + _LOG + 'use = "holdout"\n',
    "no TOML": _HEAD + "[[log]\n",
    "kind that the log is not": _HEAD + _LOG.replace("motion-motor", "valve-pwm"),
    "static friction that is none": _HEAD + _LOG.replace("motion-motor", "friction-static"),
    "a tank on this rig": _HEAD + _LOG.replace("motion-motor", "tank"),
    "valve flow of a motion": _HEAD + _LOG.replace("motion-motor", "valve-flow"),
    "valve time of a motion": _HEAD + _LOG.replace("motion-motor", "valve-time"),
    "points of a motion": _HEAD + _LOG.replace("motion-motor", "friction-points"),
    "motion alone": _HEAD + _LOG,
}


def _campaign(text: str, words: list[str]) -> Spoil:
    def spoil(folder: Folder) -> list[str]:
        folder.write("campaign.toml", text)
        if "--bundle" in words:
            folder.bundle("diagnosed")
        return words

    return spoil


def _campaigns() -> dict[str, Spoil]:
    cases = {f"campaign: {k}": _campaign(text, _FIT) for k, text in _CAMPAIGNS.items()}
    for name in ("no rig", "kind unknown", "file absent", "used twice", "a tank on this rig"):
        for word, words in _WORDS.items():
            cases[f"campaign: {name}, {word}"] = _campaign(_CAMPAIGNS[name], words)
    return cases


def _only(*words: str, bundle: str | None = None) -> Spoil:
    def spoil(folder: Folder) -> list[str]:
        if bundle:
            folder.bundle(bundle)
        return list(words)

    return spoil


_MAT = ("--format", "mat", "-o", "x.mat")
_SIM = ("simulate", "motion.csv", "--bundle", "bundle.json", "-o", "out.csv")
_CONVERT = ("convert", "motion.csv", "-o", "log.csv")

_ARGUMENTS: dict[str, Spoil] = {
    "nothing": _only(),
    "unknown command": _only("frobnicate"),
    "misspelt command": _only("chek", "motion.csv"),
    "unknown option": _only("--colour"),
    "check nothing": _only("check"),
    "check a file that is not there": _only("check", "gone.csv"),
    "check a folder": _only("check", "."),
    "check with an absent rig": _only("check", "motion.csv", "--rig", "gone.toml"),
    "check a bundle": _only("check", "bundle.json", bundle="tank"),
    "check unknown option": _only("check", "motion.csv", "--jsn"),
    "check map without equals": _only("check", "motion.csv", "--map", "theta_rad"),
    "check map of nothing": _only("check", "motion.csv", "--map", "=x"),
    "fit nothing": _only("fit"),
    "fit unknown part": _only("fit", "frictions"),
    "fit absent campaign": _only("fit", "gone.toml"),
    "fit a rig as a campaign": _only("fit", "rig.toml"),
    "fit friction nothing": _only("fit", "friction"),
    "fit friction kind": _only("fit", "friction", "motion.csv", "--kind", "rolling"),
    "fit friction cutoff text": _only("fit", "friction", "motion.csv", "--cutoff", "low"),
    "fit friction cutoff zero": _only("fit", "friction", "motion.csv", "--cutoff", "0"),
    "fit friction cutoff high": _only("fit", "friction", "motion.csv", "--cutoff", "9e9"),
    "fit friction both outputs": _only(
        *("fit", "friction", "motion.csv", "-o", "a.json", "--into", "bundle.json"), bundle="tank"
    ),
    "fit friction into nothing": _only("fit", "friction", "motion.csv", "--into", "gone.json"),
    "fit friction motion as static": _only("fit", "friction", "motion.csv", "--kind", "static"),
    "fit friction inertia": _only("fit", "friction", "motion.csv", "--inertia"),
    "fit valve-discrete of a motion": _only("fit", "valve-discrete", "motion.csv"),
    "fit valve-discrete valve c": _only("fit", "valve-discrete", "motion.csv", "--valve", "c"),
    "fit valve-pwm of a motion": _only("fit", "valve-pwm", "motion.csv"),
    "fit valve-pwm surface": _only("fit", "valve-pwm", "motion.csv", "--surface", "spline"),
    "fit valve-pwm seed": _only("fit", "valve-pwm", "motion.csv", "--seed", "-1"),
    "fit valve-pwm seed text": _only("fit", "valve-pwm", "motion.csv", "--seed", "x"),
    "convert nothing": _only("convert"),
    "convert without output": _only("convert", "motion.csv"),
    "convert to itself": _only("convert", "motion.csv", "-o", "motion.csv"),
    "convert to another kind": _only("convert", "motion.csv", "-o", "log.xlsx"),
    "convert absent": _only("convert", "gone.mat", "-o", "log.csv"),
    "convert a sheet of text": _only(*_CONVERT, "--sheet", "one"),
    "convert unknown column": _only(*_CONVERT, "--map", "time_s=t"),
    "convert unknown unit": _only(*_CONVERT, "--map", "theta_rad=theta_rad:foo"),
    "convert set text": _only(*_CONVERT, "--set", "theta_rad=a"),
    "convert set without value": _only(*_CONVERT, "--set", "theta_rad"),
    "convert set unknown": _only(*_CONVERT, "--set", "flavour=3"),
    "convert rows": _only(*_CONVERT, "--rows", "a:b"),
    "convert rows beyond": _only(*_CONVERT, "--rows", "900:950"),
    "convert skip": _only(*_CONVERT, "--skip-rows", "-3"),
    "convert period": _only(*_CONVERT, "--period", "0"),
    "convert atmosphere": _only(*_CONVERT, "--atmosphere", "1"),
    "convert decimal": _only(*_CONVERT, "--decimal", ";"),
    "convert absent spec": _only(*_CONVERT, "--spec", "gone.toml"),
    "convert a rig as spec": _only(*_CONVERT, "--spec", "rig.toml"),
    "validate nothing": _only("validate"),
    "validate without bundle": _only("validate", "campaign.toml"),
    "validate absent": _only("validate", "gone.toml", "--bundle", "bundle.json", bundle="tank"),
    "diagnose without bundle": _only("diagnose", "campaign.toml"),
    "diagnose seed": _only("diagnose", "c.toml", "--bundle", "b.json", "--seed", "-1"),
    "simulate nothing": _only("simulate"),
    "simulate without output": _only("simulate", "motion.csv", "--bundle", "bundle.json"),
    "simulate absent bundle": _only(*_SIM),
    "simulate absent log": _only("simulate", "gone.csv", *_SIM[2:], bundle="diagnosed"),
    "simulate unknown model": _only(*_SIM, "--valve-model", "spline", bundle="diagnosed"),
    "simulate no duty for a surface": _only(*_SIM, "--valve-model", "ann", bundle="diagnosed"),
    "simulate without friction": _only(*_SIM, bundle="valve_time"),
    "simulate a linear bundle": _only(*_SIM, bundle="made_linear"),
    "simulate friction alone": _only(*_SIM, bundle="friction_partial"),
    "simulate a tank": _only(*_SIM, bundle="tank"),
    "simulate points": _only(*_SIM, bundle="friction_points"),
    "simulate absent effects": _only(*_SIM, "--effects", "gone.py", bundle="diagnosed"),
    "simulate to another kind": _only(*_SIM[:-1], "out.txt", bundle="diagnosed"),
    "simulate to no folder": _only(*_SIM[:-1], "no/out.csv", bundle="diagnosed"),
    "run without folder": _only("run", "campaign.toml"),
    "run absent": _only("run", "gone.toml", "-o", "results"),
    "run surface": _only("run", "c.toml", "-o", "results", "--surface", "x"),
    "run into a file": _only("run", "campaign.toml", "-o", "rig.toml"),
    "demo without folder": _only("demo"),
    "demo seed": _only("demo", "-o", "results", "--seed", "x"),
    "export nothing": _only("export"),
    "export without format": _only("export", "bundle.json", "-o", "x.h"),
    "export without output": _only("export", "bundle.json", "--format", "c"),
    "export format": _only("export", "bundle.json", "--format", "xml", "-o", "x"),
    "export absent": _only("export", "gone.json", *_MAT),
    "export a folder": _only("export", ".", *_MAT),
    "export a log": _only("export", "motion.csv", *_MAT),
    "export to no folder": _only(
        *("export", "bundle.json", "--format", "c", "-o", "no/x.h"), bundle="tank"
    ),
    "export to a folder": _only(
        *("export", "bundle.json", "--format", "c", "-o", "."), bundle="tank"
    ),
    "export absent effects": _only(
        *("export", "bundle.json", *_MAT, "--effects", "gone.py"), bundle="tank"
    ),
    "export effects that are none": _only(
        *("export", "bundle.json", *_MAT, "--effects", "motion.csv"), bundle="tank"
    ),
    "compare one": _only("compare", "bundle.json", bundle="tank"),
    "compare absent": _only("compare", "bundle.json", "gone.json", bundle="tank"),
    "compare a log": _only("compare", "bundle.json", "motion.csv", bundle="tank"),
    "fleet nothing": _only("fleet", "-o", "out"),
    "fleet absent": _only("fleet", "gone.toml", "-o", "out"),
    "fleet twice": _only("fleet", "motion.toml", "motion.toml", "-o", "out"),
    "fleet into a file": _only("fleet", "motion.toml", "-o", "rig.toml"),
    "fleet no scheduler": _only(*("fleet", "motion.toml", "-o", "out", "--scheduler", "nonsense")),
    "effects unknown": _only("effects", "no-such-effect"),
    "effects misspelt": _only("effects", "backlsh"),
    "effects picture of none": _only("effects", "-o", "x.svg"),
    "effects picture of another kind": _only("effects", "backlash", "-o", "x.txt"),
    "effects absent file": _only("effects", "--effects", "gone.py"),
    "init nothing": _only("init"),
    "init over a file": _only("init", "rig.toml"),
    "init in no folder": _only("init", "no/rig.toml"),
    "init a folder": _only("init", "."),
    "init two": _only("init", "a.toml", "b.toml"),
}

CASES: dict[str, Spoil] = {
    **_rig_keys(),
    **_rig_slips(),
    **_campaigns(),
    **{f"arguments: {name}": spoil for name, spoil in _ARGUMENTS.items()},
}
