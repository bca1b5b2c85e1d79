"""From on/off tests of a held piston to one fit of the whole curves; `sysid.valve_discrete`
is the pipeline."""
