"""Input: rig, log and campaign files, a lab's own formats, units, plausibility.

`rig` (declared in `rig_file` and `rig_sections`, template in `rig_template`), `logs` (reading;
`samples`: a `Log` and its `Trial`s), `campaign`, `trial_kind`; `channels` declares each channel
once; `tables` and `files` read and write, `file_kinds` detects what a file is, `units` maps columns
(spellings: `unit_text`, a sensor's range: `sensor_range`), `measured_speed` stands in for a
position, `plausibility` finds wrong units, `trust/` finds and fixes faulty samples, `foreign/` and
`conversion` convert a lab's own files (`foreign_columns`; `alignment` brings columns of different
rates together, `time_breaks` finds why a time goes back).
"""
