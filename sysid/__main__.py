"""`python -m sysid` is `sysid`."""

import sys

from sysid.commands.app import main

sys.exit(main())
