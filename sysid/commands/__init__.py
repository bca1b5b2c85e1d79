"""The command line, one file a command; `app` is the group, `printing` what several print.

A command reads paths, calls the library and prints; it computes nothing.
"""
