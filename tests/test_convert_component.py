"""`convert --component`: the targets are the component's columns, in their units."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from own_components import done, refused
from test_own_component_files import CAMPAIGN, GOOD, RIG

from sysid.components.loading import one_component
from sysid.components.own_tests import out_of_range
from sysid.io.samples import Trial

VALVE = GOOD.replace(
    '{"push_n": LogColumn("N", "input"), ',
    '{"push_n": LogColumn("", "input", lower=0.0, upper=1.0), ',
)
RAW = "t;F;v\n0,00;0,1;1,0\n0,05;0,2;1,1\n0,10;0,3;1,3\n"


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "cart.py").write_text(GOOD, "utf-8")
    (tmp_path / "raw.csv").write_text(RAW, "utf-8")
    return tmp_path


def maps(*entries: str) -> list[str]:
    return [word for entry in entries for word in ("--map", entry)]


def test_a_text_with_decimal_commas(folder: Path) -> None:
    found = done(
        "convert", folder / "raw.csv", "-o", folder / "run.csv", "--component", folder / "cart.py",
        *maps("time_s=t", "push_n=F:kN", "speed_m_per_s=v:mm/s"),
    )  # fmt: skip
    assert "runs the user's own code" in found.err and "(Cart)" in found.err
    text = (folder / "run.csv").read_text("utf-8")
    assert text.endswith("time_s,push_n,speed_m_per_s\n0.0,100.0,0.001\n0.05,200.0,0.0011\n"
                         "0.1,300.0,0.0013\n")  # fmt: skip
    (folder / "rig.toml").write_text(RIG, "utf-8")
    (folder / "campaign.toml").write_text(
        CAMPAIGN.split('\n\n[[log]]\nkind = "cart"\nfile = "other')[0], "utf-8"
    )
    done("check", folder / "campaign.toml", "--component", folder / "cart.py")


def test_excel_a_recipe_and_a_constant(folder: Path) -> None:
    import pandas as pd

    frame = pd.DataFrame({"t": [0.0, 0.1, 0.2], "v": [1.0, 2.0, 4.0]})
    frame.to_excel(folder / "raw.xlsx", index=False)
    (folder / "lab.toml").write_text(
        '[map]\ntime_s = "t"\nspeed_m_per_s = {column = "v", from = [0, 10], to = [0, 1], unit = '
        '"m/s"}\n[constants]\npush_n = 2.5\n',
        "utf-8",
    )
    done("convert", folder / "raw.xlsx", "-o", folder / "run.csv", "--spec", folder / "lab.toml",
         "--component", folder / "cart.py")  # fmt: skip
    text = (folder / "run.csv").read_text("utf-8")
    assert text.endswith("time_s,push_n,speed_m_per_s\n0.0,2.5,0.1\n0.1,2.5,0.2\n0.2,2.5,0.4\n")


def test_an_input_holds_and_an_output_does_not(folder: Path) -> None:
    done("convert", folder / "raw.csv", "-o", folder / "run.csv", "--component", folder / "cart.py",
         "--resample", "0.025", *maps("time_s=t", "push_n=F", "speed_m_per_s=v"))  # fmt: skip
    rows = [r.split(",") for r in (folder / "run.csv").read_text("utf-8").splitlines()[-5:]]
    assert [r[1] for r in rows] == ["0.1", "0.1", "0.2", "0.2", "0.3"]
    assert float(rows[1][2]) == pytest.approx(1.05)


@pytest.mark.parametrize(
    ("entries", "said"),
    [
        (["time_s=t", "pushn=F"], "'pushn' is not a column of the component's logs; did you mean"),
        (["time_s=t", "theta_rad=F"], "use one of time_s, test, push_n, speed_m_per_s"),
        (["time_s=t", "push_n=F:kPa"], "'kPa' is a pressure, not a force"),
        ([], 'map its columns: --map "time_s=t:s" --map "push_n=F:N"'),
    ],
)  # fmt: skip
def test_refused_in_one_line(entries: list[str], said: str, folder: Path) -> None:
    command = ("convert", folder / "raw.csv", "-o", folder / "run.csv", "--component")
    assert said in refused(*command, folder / "cart.py", *maps(*entries))
    assert not (folder / "run.csv").exists()


def test_several_components_in_one_file(folder: Path) -> None:
    second = GOOD[GOOD.index("class Cart") :].replace("Cart", "Sled").replace('"cart"', '"sled"')
    (folder / "two.py").write_text(f"{GOOD}\n\n{second}", "utf-8")
    command = ("convert", folder / "raw.csv", "-o", folder / "run.csv", "--component")
    entries = maps("time_s=t", "push_n=F", "speed_m_per_s=v")
    line = refused(*command, folder / "two.py", *entries)
    assert "defines 2 components, Cart, Sled; name one: --component" in line
    done(*command, f"{folder / 'two.py'}:Sled", *entries)


def range_lines(folder: Path, values: list[float]) -> list[str]:
    (folder / "cart.py").write_text(VALVE, "utf-8")
    channels = {"push_n": np.array(values), "speed_m_per_s": np.zeros(len(values))}
    trial = Trial("", np.arange(len(values)) * 0.1, channels, "run.csv")
    return out_of_range(one_component(str(folder / "cart.py")), [trial])


def test_bounds_allow_for_rounding_and_name_no_blank_unit(folder: Path) -> None:
    assert not range_lines(folder, [0.0, 255 * 0.00392157])
    assert not range_lines(folder, [-0.001, 1.0])
    (line,) = range_lines(folder, [0.0, 1.05])
    assert line.endswith("outside the declared 0 to 1: is it a ratio?")


@pytest.mark.parametrize("ratio", ["0.00392157", "1/255", "0..255 -> 0..1", "0.392157 percent"])
def test_a_ratio_in_a_campaign(ratio: str, folder: Path) -> None:
    (folder / "cart.py").write_text(VALVE, "utf-8")
    (folder / "rig.toml").write_text(RIG, "utf-8")
    rows = "\n".join(f"{k / 50},{255 if k % 20 < 10 else 100},{k / 100}" for k in range(60))
    (folder / "run.csv").write_text(f"Time,PWM,v\n{rows}\n", "utf-8")
    (folder / "campaign.toml").write_text(
        f'rig = "rig.toml"\n[map]\ntime_s = "Time"\npush_n = "PWM:{ratio}"\n'
        'speed_m_per_s = "v"\n[[log]]\nkind = "cart"\nfile = "run.csv"\n',
        "utf-8",
    )
    found = done("check", folder / "campaign.toml", "--component", folder / "cart.py")
    assert "outside" not in found.out + found.err
