"""The same half second of a test in the formats of five programs."""

import numpy as np
import pandas as pd
from nptdms import ChannelObject, TdmsWriter
from scipy.io import savemat

time = np.arange(500) / 1000.0  # s
pressure = 2.0 - 0.5 * np.cos(2 * np.pi * 3.0 * time)  # bar, gauge
angle = 20.0 * np.sin(2 * np.pi * 3.0 * time)  # degrees

# LabVIEW's text file: a header for the file, one for the segment, then the table between tabs.
HEADER = """LabVIEW Measurement\t
Writer_Version\t2
Reader_Version\t2
Separator\tTab
Decimal_Separator\t.
Multi_Headings\tNo
X_Columns\tNo
Time_Pref\tRelative
***End_of_Header***\t
\t
Channels\t2\t\t
Samples\t500\t500\t
Y_Unit_Label\tbar\tdeg\t
X0\t0.0000000000000000E+0\t0.0000000000000000E+0\t
Delta_X\t0.001000\t0.001000\t
***End_of_Header***\t\t\t
X_Value\tP1\tphi\tComment
"""
with open("labview.lvm", "w") as file:
    file.write(HEADER)
    for row in zip(pressure, angle):
        file.write("".join(f"\t{value:.6f}" for value in row) + "\n")

# LabVIEW's binary file: waveforms with their own sampling period.
wave = {"wf_start_offset": 0.0, "wf_increment": 0.001, "wf_samples": len(time)}
with TdmsWriter("labview.tdms") as file:
    file.write_segment(
        [
            ChannelObject("Run", "P1", pressure, properties=wave),
            ChannelObject("Run", "phi", angle, properties=wave),
        ]
    )

# MATLAB: a struct of vectors.
savemat("matlab.mat", {"rec": {"t": time, "P1": pressure, "phi": angle}})

# Excel: one sheet per run.
table = pd.DataFrame({"t [ms]": 1e3 * time, "P1 [bar]": pressure, "phi [deg]": angle})
table.to_excel("excel.xlsx", sheet_name="Run 3", index=False)

# A PC's loop: semicolons, decimal commas, and a clock that drifts and jitters.
rng = np.random.default_rng(1)
drifting = 1e3 * np.cumsum(0.001 * (1 + 0.02 * time) * rng.uniform(0.9, 1.1, len(time)))
with open("drifting.csv", "w") as file:
    file.write("Zeit [ms];P1 [bar];phi [deg]\n")
    for row in zip(drifting, pressure, angle):
        file.write(";".join(f"{value:.4f}" for value in row).replace(".", ",") + "\n")

# An oscilloscope: its settings, separated like the table under them.
with open("scope.csv", "w") as file:
    file.write("Model,MSO24\nProbe Attenuation,1,1\nVertical Units,V,V\n,,\nTIME,CH1,CH2\n")
    for row in zip(time, pressure, angle):
        file.write(",".join(f"{value:.6f}" for value in row) + "\n")

# A controller on a serial line: started twice, and a motor's command sent every tenth row only.
with open("appended.csv", "w") as file:
    for start in ("06.05.2024 14:22:10", "06.05.2024 14:31:55"):
        file.write(f"{start}\nms,phi,volts\n")
        for row, value in enumerate(angle[:200]):
            volts = f"{0.01 * row:.2f}" if row % 10 == 0 else ""
            file.write(f"{row},{value:.4f},{volts}\n")
