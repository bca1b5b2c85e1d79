"""What a user of the library calls: objects in, objects out; `import sysid` shows all of it.

A module a task: reading files, fitting, simulating, diagnosing, validating and checking, and
what is written. Commands and notebooks call the same functions.
"""
