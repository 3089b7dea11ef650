import sys
from pathlib import Path

from coupling.stability.carry_out import one

one(sys.argv[1], Path(sys.argv[2]))
