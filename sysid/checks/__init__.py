"""What a log can be used for: `log_check` its quality, `identifiability` its parameters."""
