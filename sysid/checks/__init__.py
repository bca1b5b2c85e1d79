"""What a log can be used for: `log_check` its quality, `identifiability` its parameters.

`friction` says which friction parameters it identifies, `consistency` compares the logs of a
campaign with one another and with the rig file.
"""
