"""What a log can be used for: `log_check` for its quality, `identifiability` for its parameters.

`campaign_check` says whether all training logs of a campaign identify everything, `friction` which
friction parameters a log identifies, `bench` those of a part tested alone, `consistency` compares
the logs of a campaign with one another and with the rig file.
"""
