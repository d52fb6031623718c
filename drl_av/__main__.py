"""``python -m drl_av`` is the ``drl-av`` command."""

import sys

from drl_av.cli import main

sys.exit(main())
