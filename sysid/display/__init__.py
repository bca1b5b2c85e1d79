"""How numbers, channels and tables are shown, in the report and in a terminal."""
