"""The commented rig file that `sysid init` writes."""

from __future__ import annotations

from pathlib import Path

from sysid.errors import input_error
from sysid.io.files import write_atomic

_HEAD = """\
# What is known about the rig before any test. SI units throughout; pressures are absolute.
# Replace the example values by your own. Sections that your rig has no part for may go.

[rig]
name = "my-actuator"
"""

_AIR = """
[air]
gas_constant_j_per_kg_k = 287.0      # R of dry air
heat_capacity_ratio = 1.4            # k
temperature_k = 293.15               # of the room and the air supply
atmospheric_pressure_pa = 101325.0   # of the day, absolute: read the barometer
supply_pressure_pa = 600000.0        # absolute: a gauge that shows 5 bar means about 600000
"""

_ROTARY = """\
motion = "rotary"
orientation = "horizontal"           # "vertical": gravity acts, theta = 0 where its torque is zero
{air}
[cylinder]
area_a_m2 = 4.524e-4                 # piston area of chamber A (bore 24 mm)
area_b_m2 = 4.207e-4                 # of chamber B: a rod makes it smaller
offset_a_m = 0.075                   # chamber A is (offset_a + y) area_a, dead volume included
offset_b_m = 0.075                   # chamber B is (offset_b - y) area_b
stroke_m = 0.127                     # y runs from -stroke/2 to +stroke/2
pitch_radius_m = 0.0375              # y = theta * pitch_radius (radius, not diameter)

[inertia]
equivalent_kg_m2 = 0.02368           # at the output shaft, without payload; or instead of it:
# arm_mass_kg = 0.30                 # (these three are needed for gravity in the vertical)
# arm_length_m = 0.46
# block_mass_kg = 0.50
payload_mass_kg = 0.0
payload_length_m = 0.370             # from the shaft to the payload

[motor]
torque_per_volt_nm = 0.0795          # torque constant x amplifier gain x gear ratio, at the output
max_torque_nm = 0.795                # what the drive can give at the output
"""

_LINEAR = """\
motion = "linear"
orientation = "horizontal"           # "vertical": the weight acts against positive motion
{air}
[cylinder]
area_a_m2 = 4.524e-4                 # piston area of chamber A (bore 24 mm)
area_b_m2 = 4.207e-4                 # of chamber B: a rod makes it smaller
offset_a_m = 0.075                   # chamber A is (offset_a + y) area_a, dead volume included
offset_b_m = 0.075                   # chamber B is (offset_b - y) area_b
stroke_m = 0.127                     # y runs from -stroke/2 to +stroke/2

[inertia]
mass_kg = 1.2                        # all that moves, without payload
payload_mass_kg = 0.0

[motor]                              # of an electric drive beside the cylinder, if there is one
force_per_volt_n = 35.0
max_force_n = 200.0
"""

_TAIL = """
[pwm]
period_s = 0.005                     # starts at every multiple from a test's first row

[valves]                             # from the valve's manual
on_delay_s = 0.0017                  # command to opening
off_delay_s = 0.0020                 # command to closing

[sampling]
period_s = 0.001

[sensors]                            # optional: taken from the data where absent
# encoder_counts_per_rev = 80000
# encoder_zero_counts = 0
# pressure_noise_pa = 250.0          # one standard deviation
"""


def rig_template(*, linear: bool) -> str:
    """A rig file with every key explained, as text."""
    body = _LINEAR if linear else _ROTARY
    text = _HEAD + body.format(air=_AIR) + _TAIL
    return (
        text.replace("encoder_counts_per_rev = 80000", "encoder_counts_per_m = 200000")
        if (linear)
        else text
    )


def write_rig_template(path: Path, *, linear: bool, force: bool) -> None:
    """Write it to `path`; InputError where a file is in the way and `force` is not given."""
    if path.exists() and not force:
        raise input_error(path, "exists already", "name another file, or say --force")
    write_atomic(path, rig_template(linear=linear))
