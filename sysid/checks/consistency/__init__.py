"""What only several logs of a campaign show together: slips of unit, time and sign.

`quantities` names what is compared, `drive`, `flow` and `levels` read it from one log each,
`comparison` finds what disagrees, `campaign` puts them together.
"""
