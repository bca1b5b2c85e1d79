"""What comes in: rig, logs and campaigns, files of any kind, units."""
