"""`python -m flowsolver` is the command `poreflow`."""

import sys

from flowsolver.command.command_line import main

sys.exit(main())
