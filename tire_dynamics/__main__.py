"""``python -m tire_dynamics``: the command ``tire-dynamics``."""

import sys

from .cli.main import main

sys.exit(main())
