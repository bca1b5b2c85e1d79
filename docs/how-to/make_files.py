"""The same half second of a test in the formats of five programs."""

import numpy as np
import pandas as pd
from nptdms import ChannelObject, TdmsWriter
from scipy.io import savemat

time = np.arange(500) / 1000.0  # s
pressure = 2.0 - 0.5 * np.cos(2 * np.pi * 3.0 * time)  # bar, gauge
angle = 20.0 * np.sin(2 * np.pi * 3.0 * time)  # degrees

# LabVIEW's text file: lines of header, then the table, separated by tabs.
with open("labview.lvm", "w") as file:
    file.write("LabVIEW Measurement\nWriter_Version\t2\nSeparator\tTab\n***End_of_Header***\n")
    file.write("X_Value\tP1\tphi\n")
    for row in zip(time, pressure, angle):
        file.write("\t".join(f"{value:.6f}" for value in row) + "\n")

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
