"""``python -m orchid_uav`` is the ``orchid`` command."""

import sys

from orchid_uav.cli.main import main

sys.exit(main())
