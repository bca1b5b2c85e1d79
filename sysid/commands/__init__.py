"""The command line: one file a command, called by the group in `app`."""
