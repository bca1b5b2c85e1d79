"""sysid: from logged tests of a pneumatic actuator to a model that controllers can trust."""

__version__ = "0.1.0"
