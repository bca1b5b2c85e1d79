"""The functions of the library: objects in, objects out; `import sysid` offers all of them.

One module per task: reading files, fitting, simulating, diagnosing, validating and checking,
and writing. Commands and notebooks call the same functions.
"""
