"""The command line, one file a command.

`app` is the group and turns errors into exit statuses, `options` and `printing` hold what
several commands take and print, `stages` what `sysid run` does, skips and resumes. A command
reads paths, calls the library and prints; it computes nothing.
"""
