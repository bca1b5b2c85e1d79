"""What a log is good for: `log_check` its quality, `identifiability` what it can identify."""
