"""The command line, one file per command.

`app` is the group and turns errors into exit statuses, `options` and `printing` hold shared
options and output. A command
reads paths, calls the library and prints; it computes nothing.
"""
